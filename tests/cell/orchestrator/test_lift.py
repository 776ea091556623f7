"""The lift turns the hand upright and stops there, whatever the arm accelerates at."""

from collections.abc import Callable
from contextlib import suppress
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from cell.base.config.settings import CellSettings, FoldSettings
from cell.base.devices.fci import start_joints
from cell.base.devices.fold_path import triangle, whole_path
from cell.orchestrator.context import FoldInputs, FoldLog
from cell.orchestrator.phases import lift
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Drive, Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from drivers.base.installation import MotionLimits
from drivers.base.motion import TICK, MotionProfile
from drivers.base.types import ZERO_VELOCITY, ArmState, HandState, Pose, Velocity
from drivers.franka.inverse_kinematics import ELBOW_JOINT, track
from drivers.franka.kinematics import forward
from drivers.franka.loop import plane_of
from drivers.franka.reach import REACTION, PredictedMotion, ReachGuard, densify
from drivers.franka.settings import REACHABLE
from policies.registry import make_policy
from tests.support.requests import CELL, DENIM

HAND = HandState(0.0, 0.0, "made", 0.001, True, False)
UPRIGHT = np.pi / 2
PERIOD, LATE = 10, 5  # ticks of the servo between commands, and until one takes effect


def lifted(
    limits: MotionLimits,
    speed: float = 0.1,
    policy: str = "triangular",
    late: range = range(0),
    watch: Callable[[MotionProfile], None] = lambda _: None,
) -> np.ndarray:
    """Pitches (n,) [rad] of an arm with these limits on its way up and in the half
    second after.

    The commands of the `late` periods do not arrive; `watch` sees the servo twice a
    period.
    """
    settings, strip = cell(limits, speed), DENIM
    given = FoldInputs(
        settings, strip, make_policy(policy), SimpleNamespace(), reader=None
    )
    profile = MotionProfile(
        limits, settings.installation.workspace, Pose(strip.length, 0.0, 0.0)
    )
    motion, pitches, k = lift(given, FoldLog(), Recorder(), snapshot(0, profile)), [], 0
    command = next(motion)
    with suppress(StopIteration):
        while True:
            k += 1
            for tick in range(PERIOD):
                if tick == LATE and k not in late:
                    assert isinstance(command, Drive)
                    profile.set_velocity(command.velocity)
                profile.tick()
                if tick in (0, LATE):
                    watch(profile)
            pitches.append(profile.pose.pitch)
            command = motion.send(snapshot(k, profile))
    assert profile.pose.z >= settings.fold.takeover_height
    profile.stop()
    return np.array([*pitches, *(profile.tick()[2] for _ in range(500))])


def cell(limits: MotionLimits, speed: float) -> CellSettings:
    settings = CELL.controller
    installation = settings.installation.model_copy(
        update={"limits": limits, "home_height": 0.25}
    )
    fold = settings.fold.model_copy(update={"speed": speed, "start": "flat"})
    return settings.model_copy(update={"installation": installation, "fold": fold})


def snapshot(k: int, profile: MotionProfile) -> Snapshot:
    now = k * PERIOD * TICK
    arm = ArmState(
        now, now, "made", profile.pose, ZERO_VELOCITY, profile.pose, True, False
    )
    return Snapshot(now, State.LIFT, 0.0, arm, HAND, View())


@pytest.mark.parametrize(
    ("policy", "speed"),
    [*product(("triangular", "circular"), (0.05, 0.1, 0.14)), ("adaptive", 0.1)],
)
@pytest.mark.parametrize("limits", [REACHABLE, MotionLimits()], ids=["robot", "twin"])
def test_the_hand_does_not_turn_past_upright(
    limits: MotionLimits, policy: str, speed: float
) -> None:
    pitches = lifted(limits, speed, policy)
    assert pitches.max() < UPRIGHT + 0.01
    assert pitches[-1] > UPRIGHT - (0.02 if policy == "triangular" else 0.25)


@pytest.mark.parametrize("begin", [102, 114, 126])
def test_commands_late_at_its_end_do_not_take_the_arm_out_of_reach(begin: int) -> None:
    guard = guarded()
    objections: list[str] = []

    def judge(profile: MotionProfile) -> None:
        if profile.moving:
            objections.append(guard.objection(profile.predict(REACTION)))

    lifted(REACHABLE, late=range(begin, begin + 9), watch=judge)
    assert len(objections) > 200
    assert set(objections) == {""}


@pytest.mark.parametrize("length", [0.3, 0.36])
def test_short_strips_begin_where_the_guard_lets_the_lift_pass(length: float) -> None:
    """The posture with the largest margin of the joints would be braked in the lift."""
    installation, settings = cell(REACHABLE, 0.1).installation, FoldSettings()
    joints = start_joints(installation, settings, length)
    plane = plane_of(installation, forward(np.array(joints)).T.ravel().tolist())
    guard = ReachGuard(plane, REACHABLE, list(joints))
    poses, times = densify(
        *whole_path(length, installation, settings, triangle(length))
    )
    objections: set[str] = set()
    for here, there, time in zip(poses[:-1], poses[1:], times[1:], strict=True):
        soon = PredictedMotion(
            Pose(*here), Velocity(*((there - here) / time)), ZERO_VELOCITY
        )
        if here[2] < np.pi / 2:
            said = guard.objection(soon)  # the guard follows the way there, too
            objections.add(said if here[2] > 0.0 else "")
    assert objections == {""}


def guarded() -> ReachGuard:
    """The guard of a robot mounted as in cell.yaml whose hand holds the strip's
    edge.
    """
    installation = cell(REACHABLE, 0.1).installation
    above = np.array(start_joints(installation, FoldSettings(), 0.6))
    plane = plane_of(installation, forward(above).T.ravel().tolist())
    joints = above
    for height in np.linspace(installation.home_height, 0.0, 26):
        joints, _ = track(
            joints, plane.matrix(0.6, height, 0.0), above[ELBOW_JOINT], 12
        )
    return ReachGuard(plane, REACHABLE, joints.tolist())
