"""A fold off the middle: `cell fold --at`, its line, and everything relative to it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.base.devices.devices import Trial
from cell.base.devices.open import open_cell
from cell.folding.fold import fold
from cell.folding.request import line_at
from cell.interface.api import predict
from cell.record.run import read_run
from cell.record.truth import read_truth
from cell.setup.calibration_in_use import calibration_of
from drivers.strip.describe import describe
from drivers.strip.engine import Touch
from drivers.strip.rod.engine import Rod
from policies.path import FoldLine
from policies.policy import at_line, folded_part
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING
from tests.support.refusals import refusal
from tests.support.requests import CELL, DENIM, request_for

LONG = DENIM.model_copy(update={"length": 0.9})


@pytest.mark.parametrize(
    ("text", "at"), [("1/3", 0.2), ("0.4", 0.24), ("200mm", 0.2), ("1/2", 0.3)]
)
def test_line_is_a_share_of_the_length_or_a_length(text, at) -> None:
    assert line_at("--at", [text], 0.6) == pytest.approx(at)


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        (["1/3", "1/3"], "a second fold carries two layers"),
        (["0.1"], "60 mm from the grasped edge, allowed 90 to 300 mm"),
        (["2/3"], "beyond the middle the grasped part is the longer one"),
        (["1/0"], "is no length"),
        (["a third"], "is no length"),
    ],
)
def test_line_that_is_not_folded_is_refused_with_its_reason(texts, says) -> None:
    with refusal(says):
        line_at("--at", texts, 0.6)


@pytest.mark.parametrize("policy", ["shifted", "feedback", "adaptive"])
def test_fold_at_a_third_is_the_half_fold_of_the_part_beyond(policy) -> None:
    line = FoldLine.of(LONG.length, LONG.length / 3)
    part = folded_part(LONG, line)
    made = make_policy(policy, in_rod=True)
    # segments of equal length
    whole, alone = Rod(150), Rod(100)
    ways = ((at_line(made, line), LONG, whole, line.goal), (made, part, alone, 0.0))
    displaced = []
    for each, strip, rod, goal in ways:
        rng = np.random.default_rng(0)
        settings = Rollout(sensing=EXACT_SENSING)
        folds = roll_out(
            each, rod, strip, [describe(strip)], settings=settings, rng=rng
        )
        displaced.append(float(folds.displacement[0]) + goal)
    assert displaced[0] == pytest.approx(displaced[1], abs=1e-3)


def test_touch_that_lays_the_edge_on_its_goal_is_not_displaced() -> None:
    line = FoldLine.of(0.6, 0.2)
    assert line.goal == pytest.approx(0.2)
    touch = Touch(1.0, x=0.37, to_grasped=0.17, to_fixed=0.37, goal=line.goal)
    assert touch.displacement == pytest.approx(0.0)


def test_effects_keep_their_places_on_the_part_that_is_folded() -> None:
    placed = {"seam": {"factor": 3.0, "position": 0.5}, "crease": {"position": 0.1}}
    strip = DENIM.model_copy(update={"effects": placed})
    part = folded_part(strip, FoldLine.of(0.6, 0.2))
    assert part.length == pytest.approx(0.4)
    assert part.effects["seam"]["position"] == pytest.approx(0.3)
    assert "crease" not in part.effects


def test_cell_learns_of_each_line_apart() -> None:
    half = request_for("denim", "adaptive", Path("runs"))
    assert replace(half, at=0.3).subject == half.subject
    assert replace(half, at=0.2).subject != half.subject


def test_prediction_is_relative_to_the_line() -> None:
    assert abs(predict("unknown:0.68", "shifted", at="0.36").displacement) < 0.03


def test_policy_says_which_part_it_does_not_fold() -> None:
    with pytest.raises(Exception, match=r"--at: folds 0\.4 m of the strip in half: ad"):
        predict("denim", at="1/3")


def test_truth_is_silent_on_what_did_not_happen() -> None:
    devices = open_cell(CELL, DENIM, Trial(), calibrating=False)
    truth = devices.plant.truth(0.0)
    devices.close()
    assert truth.pop("plant")["name"] == "denim"
    assert set(truth.values()) == {None}


@pytest.mark.slow
def test_fold_off_the_middle_lies_on_its_line_and_its_run_is_read(tmp_path) -> None:
    asked = request_for("unknown:0.68", "adaptive", tmp_path)
    asked = replace(asked, at=0.36 * 0.68)
    result = fold(asked, calibration_of(asked.cell))
    assert result.outcome == "layer_touch", result
    assert abs(result.displacement_true) < 0.0015
    assert abs(result.edge_offset_true) < 0.001
    assert result.edge_offset == pytest.approx(result.edge_offset_true, abs=0.0015)
    run = read_run(Path(result.run))
    assert run.header.line == pytest.approx(0.2448)
    lengths = run.result.l1 - run.result.l2 + 0.68 - 2 * run.header.line
    assert run.result.displacement == pytest.approx(lengths)
    assert read_truth(run.folder)["displacement"] == result.displacement_true


@pytest.mark.slow
def test_layer_that_bows_up_as_it_is_pushed_lies_flat_in_the_end(tmp_path) -> None:
    trial = Trial(seed=1)
    asked = request_for("jacket-knit", "adaptive", tmp_path, trial=trial)
    result = fold(asked, calibration_of(asked.cell))
    assert abs(result.edge_offset_true) < 0.001
