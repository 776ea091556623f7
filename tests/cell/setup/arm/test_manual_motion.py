"""The arm by hand and in a calibration: never into the desk."""

import signal
from itertools import islice

import pytest

from calibration.wizard.progress import Progress
from calibration.wizard.touched_points import TouchedPoints, request_text
from cell.base.devices.devices import Trial
from cell.orchestrator.calibration_phase import _measure_latency, calibrate
from cell.orchestrator.context import CalibrationInputs, CalibrationLog
from cell.orchestrator.monitors import Rules
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import OpenHand
from cell.setup.arm.manual_motion import jog, move_manually
from cell.setup.arm.run_settings import slow_down
from drivers.base.errors import Fault
from drivers.base.types import Pose
from tests.support.commands import run
from tests.support.plain_cell import of_arm
from tests.support.requests import CELL
from tests.support.twin_calibration import twin_calibration

UPRIGHT = Pose(0.3, 0.05, 1.57)


def touching(first: Pose, last: Pose, **given: object) -> CalibrationInputs:
    """A calibration that touches points between the `first` and the `last`."""
    plan = (first, *(Pose(0.1 + 0.03 * i, 0.05, 1.57) for i in range(15)), last)
    lens = twin_calibration(CELL.twin.camera).lens
    points = TouchedPoints(lens, CELL.touches, plan)
    return CalibrationInputs(CELL.controller, points, **given)


def stating(desk: float | None):
    place = CELL.installation.model_copy(update={"desk": desk})
    return CELL.model_copy(update={"installation": place})


@pytest.mark.parametrize(
    ("desk", "x", "z", "name"),
    [
        (None, -0.1, -0.14, "hand_meets_desk"),
        (0.6, -0.1, -0.14, "hand_meets_desk"),
        # nobody said that the desk ends with the strip
        (None, 0.05, -0.12, "hand_meets_desk"),
        (0.6, 0.05, -0.12, "moved"),
        (None, -0.1, -0.05, "hand_meets_desk"),  # the fingers reach 9 mm further
        (None, -0.1, -0.03, "moved"),
    ],
)
def test_jog_does_not_drive_the_hand_into_the_desk(desk, x, z, name) -> None:
    outcome = move_manually(stating(desk), Trial(), jog(x, z, 0.0))
    assert outcome.name == name
    assert outcome.exit_code == (0 if name == "moved" else 4)


def test_first_signal_asks_for_a_controlled_stop_of_a_motion_by_hand(
    monkeypatch,
) -> None:
    def moving(_settings, _choice, _motion, interrupted) -> Outcome:
        signal.raise_signal(signal.SIGINT)
        return Outcome("asked", "to stop", 7 * interrupted())

    monkeypatch.setattr("cell.setup.arm.manual_motion.move_manually", moving)
    assert run(monkeypatch, "open") == 7


def test_small_negative_pitch_is_stated_as_zero() -> None:
    outcome = move_manually(CELL, Trial(), jog(0.0, 0.001, -1e-3))
    assert outcome.reason == "the gripper is at x 600, z 151 mm, pitch 0 deg"


@pytest.mark.parametrize(
    ("first", "last"),
    [
        (UPRIGHT, UPRIGHT),
        (UPRIGHT, Pose(0.3, 0.02, 0.0)),
        (Pose(0.1, 0.2, 0.0), UPRIGHT),
    ],
)
def test_plan_that_leads_into_the_desk_is_refused_before_anybody_is_asked(
    first, last
) -> None:
    low = of_arm(commanded=Pose(0.3, 0.02, 1.57))
    phase = calibrate(touching(first, last), CalibrationLog(), Recorder(), low)
    if first == last:
        assert next(phase) == OpenHand()
        return
    with pytest.raises(Fault, match="into the desk at x 300"):
        next(phase)


def test_steps_of_the_camera_s_latency_are_announced_with_their_place() -> None:
    told: list[Progress] = []
    given = touching(UPRIGHT, UPRIGHT, watch=told.append)
    _, step = islice(_measure_latency(given, CalibrationLog().steps), 2)
    assert told[0].request == request_text(step.pose)


def test_monitors_know_the_limits_of_the_motion(monkeypatch) -> None:
    seen: list[Rules] = []
    monkeypatch.setattr(
        "cell.orchestrator.run.check_all", lambda *given: seen.append(given[2])
    )
    slow = slow_down(CELL)
    move_manually(slow, Trial(), jog(0.0, 0.001, 0.0))
    assert {rules.motion for rules in seen} == {slow.installation.limits}
