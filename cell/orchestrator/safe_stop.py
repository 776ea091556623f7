"""Emergency stop of the arm, independent of vision, record and policy."""

from collections.abc import Callable
from math import hypot

from cell.base.devices.devices import Devices
from drivers.base.types import ArmState, HandState

REST_SPEED = 1e-3  # m/s of the gripper below which it rests


def run_suppressed(action: Callable[[], object]) -> bool:
    """Run `action` and return whether it succeeded; its exceptions are suppressed."""
    try:
        action()
    except Exception:  # noqa: BLE001  an edge: whatever fails, the arm still has to stop
        return False
    return True


class SafeStop:
    """Emergency stop that repeats its command until the arm confirms it; uses no other
    device.
    """

    def __init__(self, devices: Devices, cycles: int) -> None:
        """Prepare to stop the arm of `devices` within `cycles` of the control loop."""
        self._devices = devices
        self._cycles_left = cycles
        self._stop_sent = False

    def apply(self, hand: HandState | None) -> None:
        """Stop the arm, and the fingers too if `hand` shows a motion or is unknown."""
        self._stop_sent = run_suppressed(self._devices.arm.stop)
        if hand is None or hand.moving:
            run_suppressed(self._devices.hand.stop)

    def brake_one_cycle(self, due: float) -> ArmState | None:
        """Brake for one cycle due at `due` [s]; return the arm's state, None where the
        arm does not answer.
        """
        self._cycles_left -= 1
        run_suppressed(lambda: self._devices.clock.wait_until(due))
        states: list[ArmState] = []
        answered = run_suppressed(lambda: states.append(self._devices.arm.state()))
        if not (answered and self._stop_sent):
            self._stop_sent = run_suppressed(self._devices.arm.stop)
        return states[0] if states else None

    def has_ended(self, arm: ArmState | None) -> bool:
        """Whether braking has ended: `arm` is at rest, though it may still creep to its
        pose, or no cycle is left.
        """
        if self._cycles_left <= 0:
            return True
        if arm is None or arm.moving or not self._stop_sent:
            return False
        return hypot(arm.velocity.vx, arm.velocity.vz) < REST_SPEED
