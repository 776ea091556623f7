"""A robot that goes where it is told, at once; and says what it was told."""

from types import SimpleNamespace


class FakeRobot:
    """Plays `drivers.arm.robot.Robot` for the loop, without a network."""

    def __init__(self, pose: list[float], joints: list[float]) -> None:
        self.pose = pose
        self.joints = joints
        self.force = [0.0] * 6
        self.torques = [0.0] * 7
        self.written: list[list[float]] = []
        self.ended = False
        self.clock = 0
        self.twist = [0.0] * 6
        self.twist_change = [0.0] * 6

    def start_poses(self) -> "FakeRobot":
        return self

    def read(self, motion: object) -> SimpleNamespace:
        self.clock += 1
        return SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda now=self.clock: 1e-3 * now),
            O_dP_EE_c=self.twist,
            O_ddP_EE_c=self.twist_change,
            q=self.joints,
            O_T_EE=self.pose,
            O_T_EE_c=self.pose,
            O_F_ext_hat_K=self.force,
            tau_ext_hat_filtered=self.torques,
            control_command_success_rate=1.0,
        )

    def write_pose(self, motion: object, pose: list[float], *, last: bool = False) -> None:
        self.written.append(pose)
        self.pose = pose
        self.ended = last
