"""What preflight and fold leave in the record, and for the operator."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cell.orchestrator import phases
from cell.orchestrator.context import FoldInputs, FoldLog
from cell.orchestrator.states import Trigger
from cell.orchestrator.steps import StillPicture
from cell.perception.preflight import CAMERA_WATCHED, UNWATCHED, PreflightCheck
from drivers.base.types import Frame, Pose
from policies.policy import Decision
from policies.registry import make_policy
from tests.support.made_folds import BELIEF, Notes
from tests.support.made_results import DONE
from tests.support.plain_cell import GOOD, POSE, showing
from tests.support.requests import CELL, DENIM

FRAME = Frame(1.0, 1.0, "test", 0, np.zeros((2, 2, 3), np.uint8))


def at_once(value: object):
    """A step that takes no tick and ends with `value`."""

    def step(*_: object):
        yield from ()
        return value

    return step


@pytest.fixture(autouse=True)
def pictured(monkeypatch) -> None:
    """A picture is there at once."""
    picture = at_once(StillPicture(1.0, FRAME, POSE))
    monkeypatch.setattr(phases.steps, "still_picture", picture)


@pytest.mark.parametrize("name", [CAMERA_WATCHED, UNWATCHED])
def test_a_camera_that_nothing_watches_is_an_event_a_warning_and_in_the_list(
    monkeypatch, name: str
) -> None:
    found = PreflightCheck(name, True, "1 place, 2 are needed", "put something there")
    monkeypatch.setattr(phases, "_camera_checks", at_once(()))
    monkeypatch.setattr(phases.steps, "move", at_once(GOOD))
    monkeypatch.setattr(phases, "_inspect", at_once((found,)))
    given = (CELL.controller, DENIM, make_policy("triangular"), None)
    inputs, log = FoldInputs(*given, reader=None), FoldLog()
    record = Notes()
    with pytest.raises(StopIteration) as end:
        next(phases.preflight(inputs, log, record, GOOD))
    assert end.value.value is Trigger.CHECKED
    kinds = [kind for kind, _ in record.events]
    assert record.events[0][1]["checks"][0]["name"] == name
    assert ("camera_unwatched" in kinds) == (name == UNWATCHED)
    said = "1 place, 2 are needed; put something there" if name == UNWATCHED else ""
    assert log.warning == said


def test_arm_goes_back_from_the_landmarks_as_it_came(monkeypatch) -> None:
    moved: list[Pose] = []
    monkeypatch.setattr(phases.steps, "open_hand", at_once(None))
    monkeypatch.setattr(phases.steps, "move", lambda pose: moved.append(pose) or ())
    monkeypatch.setattr(phases, "check_camera", lambda *_: None)
    landmarks = SimpleNamespace(pitch=0.4, pose=POSE)
    calibration = SimpleNamespace(landmarks=landmarks)
    given = FoldInputs(CELL.controller, DENIM, None, calibration, reader=None)
    checks = phases._camera_checks(given)
    next(checks)
    with pytest.raises(StopIteration):
        checks.send(GOOD)
    turned, _, back, end = moved
    assert (back, end) == (turned, GOOD.arm.commanded)


def test_every_prediction_is_recorded_and_where_it_loses_sight_and_sees_again() -> None:
    said = [None, BELIEF, replace(BELIEF, blind=True), BELIEF]
    on = Decision(*np.zeros((2, 1)), np.zeros(1, bool))
    policy = SimpleNamespace(decide=lambda _: on, prediction=lambda: said.pop(0))
    record = Notes()
    phase = phases.fold(SimpleNamespace(policy=policy), FoldLog(), record, GOOD)
    next(phase)
    for _ in range(4):
        phase.send(showing(read=True))
    told = (
        "decided decided foretold decided foretold policy_blind decided foretold"
        " policy_sees"
    )
    assert [k for k, _ in record.events] == told.replace("decided", "decision").split()


@pytest.mark.parametrize("displacement", [None, 0.001])
def test_warning_is_a_line_of_its_own_whatever_came_of_the_fold(displacement) -> None:
    result = replace(
        DONE,
        outcome="unlike_model",
        reason="it is stiff",
        exit_code=1,
        displacement=displacement,
        warning="it is stiff\n  the camera is not watched",
    )
    lines = str(result).splitlines()
    assert lines[-1] == "  the camera is not watched"
    assert sum("it is stiff" in line for line in lines) == (
        2 if displacement is None else 1
    )
