"""A fold is compared with the model once it is over, and the operator is told what to
do.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from cell.folding.documents import result_content
from cell.folding.fold_trace import UNLIKE_REASON, FoldTrace
from cell.folding.result import FoldResult
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from cell.perception.model_agreement import MeasuredFold
from cell.perception.strip_measurement import StripMeasurement
from cell.record.header import Result
from drivers.base.types import ZERO_VELOCITY, ArmState, Array, HandState, Pose
from tests.support.made_folds import BELIEF, OUTCOME, STRIP, TOUCH, Notes, measured
from tests.support.made_results import DONE

ANOTHER_LAW = {"quadratic_damping": (("coefficient", 0.02),)}


def smooth(points: Array) -> Array:
    """A curve of many points through those of a profile, as images show it."""
    at = np.arange(len(points))
    return np.asarray(CubicSpline(at, points)(np.linspace(0, at[-1], 80)))


def traced(fold: MeasuredFold) -> FoldTrace:
    """A trace that saw `fold` tick by tick."""
    trace, hand = FoldTrace(STRIP), HandState(0.0, 0.0, "made", 0.0, True, False)
    new = 0
    for time, (x, z, pitch) in zip(fold.t, fold.poses, strict=True):
        seen = None
        if new < len(fold.stamp) and fold.stamp[new] <= time:
            points, stamp = smooth(fold.profile[new]), float(fold.stamp[new])
            grip, nothing = (float(points[-1, 0]), float(points[-1, 1])), float("nan")
            contact = float(points[0, 0])
            shown = (contact, 1.0, points[1:-1], 1.0, (0.5, 0.1))
            seen = StripMeasurement(stamp, new, *shown, nothing, nothing, grip)
            new += 1
        pose = Pose(float(x), float(z), float(pitch))
        arm = ArmState(
            float(time), float(time), "made", pose, ZERO_VELOCITY, pose, True, False
        )
        state, new_image = State.FOLD if time > 1.4 else State.LIFT, seen is not None
        trace.handle_tick(
            Snapshot(
                time,
                state,
                0.0,
                arm,
                hand,
                View(None, new_image, 0, seen, read=new_image),
            )
        )
    return trace


def ended(fold: MeasuredFold) -> Outcome:
    """The outcome of `fold`, with its own touch."""
    return replace(OUTCOME, touch=replace(TOUCH, time=float(fold.t[-1])))


def finished(outcome: Outcome) -> FoldResult:
    warning = outcome.agreement.sentence()
    return replace(DONE, predicted=BELIEF.sentence(), warning=warning)


def test_fold_of_the_models_law_agrees_and_raises_no_event() -> None:
    notes = Notes()
    outcome = traced(measured()).review(ended(measured()), notes)
    assert outcome.agreement.like_model
    assert not notes.events
    assert Result.model_validate(result_content(outcome)).agreement.like_model


def test_fold_of_another_law_is_flagged_in_event_result_and_final_line() -> None:
    notes = Notes()
    fold = measured(**ANOTHER_LAW)
    outcome = traced(fold).review(ended(fold), notes)
    ((kind, facts),) = notes.events
    assert kind == UNLIKE_REASON
    assert (outcome.name, outcome.exit_code) == (UNLIKE_REASON, 1)
    assert "cell gap" in str(facts["reason"])
    note = Result.model_validate(result_content(outcome)).agreement
    assert not note.like_model
    assert note.residual == pytest.approx(outcome.agreement.residual)
    assert "does not behave like the model" in str(finished(outcome)).splitlines()[-1]


def test_strip_that_lies_folded_is_not_called_unfolded() -> None:
    said = str(replace(DONE, outcome=UNLIKE_REASON, exit_code=1, displacement=0.0))
    assert said.startswith(
        "denim: folded (unlike_model), displacement +0.0 mm; laid down"
    )
    assert "not folded (edges_apart)" in str(
        replace(DONE, outcome="edges_apart", exit_code=1)
    )
