"""The pause after the lift of a run that starts hanging."""

from typing import Any

import numpy as np
import pytest

from cell.orchestrator.phases import REST_TRAVEL as AT_REST, wait_until_still
from cell.orchestrator.snapshot import MoveTo, Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.types import ZERO_VELOCITY, ArmState, Frame, HandState, Pose
from tests.support.made_folds import Notes

TICK, FRAME = 0.01, 2  # s, ticks from image to image
HAND = HandState(0.0, 0.0, "made", 0.001, True, False)
BRAKES = 0.1  # s


def paused(
    swing: float, decay: float, longest: float = 4.0, noise: float = 0.0
) -> tuple[Any, ...]:
    """How long [s] a strip that swings by `swing` [m] is waited for, its facts, the
    commands.

    The swing halves every `decay` [s]; each point is read with `noise` [m].
    """
    notes, commands, rng = Notes(), [], np.random.default_rng(1)
    motion, pose, k = wait_until_still(longest, notes), Pose(0.5, 0.1, 1.45), 0
    command = next(motion)
    try:
        while True:
            commands.append(command)
            k += 1
            if isinstance(command, MoveTo):
                pose = command.pose
            command = motion.send(snapshot(k, pose, swing, decay, noise, rng))
    except StopIteration as end:
        return end.value.time, dict(notes.events)["hanging"], commands


def snapshot(
    k: int,
    pose: Pose,
    swing: float,
    decay: float,
    noise: float,
    rng: np.random.Generator,
) -> Snapshot:
    now = TICK * k
    arm = ArmState(now, now, "made", pose, ZERO_VELOCITY, pose, now < BRAKES, False)
    curve = np.linspace((0.4, 0.0), (pose.x, pose.z), 40)
    off = swing * 0.5 ** (now / decay) * np.cos(12.0 * now)
    curve[:, 0] += off * np.sin(np.linspace(0.0, np.pi, 40)) + rng.normal(
        0.0, noise, 40
    )
    frame = Frame(now, now, "made", k // FRAME, np.zeros((2, 2, 3), np.uint8))
    place, nothing = (pose.x, pose.z), float("nan")
    seen = StripMeasurement(
        now, k // FRAME, 0.4, 1.0, curve, 1.0, place, nothing, nothing, gripper=place
    )
    new = k % FRAME == 0
    view = View(frame, fresh=new, measurement=seen, read=new)
    return Snapshot(now, State.LIFT, 0.0, arm, HAND, view)


def test_a_strip_at_rest_is_waited_for_as_briefly_as_images_allow() -> None:
    time, facts, _ = paused(swing=0.0, decay=1.0, noise=0.001)
    assert facts["still"] is True
    assert BRAKES < time < BRAKES + 0.7


def test_a_strip_that_swings_is_waited_for_until_it_hangs_still() -> None:
    time, facts, _ = paused(swing=0.01, decay=0.3)
    assert facts["still"] is True
    assert facts["moved"] < AT_REST
    assert 0.01 * 0.5 ** (time / 0.3) < 0.0005
    assert time > BRAKES + 0.8


def test_a_strip_that_never_rests_is_waited_for_no_longer_than_allowed() -> None:
    time, facts, _ = paused(swing=0.02, decay=100.0, longest=1.5)
    assert facts["still"] is False
    assert facts["moved"] > AT_REST
    assert time == pytest.approx(BRAKES + 1.5, abs=0.06)
