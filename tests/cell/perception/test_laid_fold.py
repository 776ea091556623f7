"""A laid fold: the offset of its edges from its loop, and whether it lies as it was
laid.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.base.devices.devices import Trial
from cell.folding.batch import fold_all
from cell.orchestrator.context import FoldLog
from cell.perception.laid_fold import TOP, LaidWeights, Loop
from cell.perception.length_checks import LengthCheck
from cell.record.run import read_run
from tests.support.made_folds import ARCH, SEEN, TOUCH
from tests.support.requests import DENIM, request_for


def test_loop_is_read_from_its_tip_its_top_and_where_it_leaves_the_desk() -> None:
    loop = Loop.seen_in(SEEN)
    assert loop is not None
    assert loop == pytest.approx((0.291, 0.02, 0.011), abs=1e-4)


@pytest.mark.parametrize(
    "hidden",
    [
        {"contact_x": np.nan},
        {"tip": (np.nan, np.nan)},
        {"profile": np.empty((0, 2))},
        {"profile": ARCH[: TOP - 1]},
    ],
)
def test_loop_that_is_not_visible_is_none(hidden: dict[str, object]) -> None:
    assert Loop.seen_in(replace(SEEN, **hidden)) is None


def ending(seen: float, *more: LengthCheck) -> tuple[str, str, int]:
    """Name, reason and exit code of a fold whose edges were released at x = 0."""
    log = FoldLog()
    log.seen_touch, log.released, log.edge_offset = TOUCH, True, seen
    log.witnesses = [
        LengthCheck("edges", seen, LaidWeights.shipped().rms),
        *more,
    ]
    end = log.completion()
    return end.name, end.reason, end.exit_code


@pytest.mark.parametrize("apart", [0.0, 0.002, -0.004])  # the last is doubted, and said
def test_fold_that_lies_where_it_was_laid_is_a_fold(apart: float) -> None:
    assert ending(apart) == ("layer_touch", "the layers touch", 0)


@pytest.mark.parametrize("apart", [-0.0625, -0.0081, 0.0046, 0.2])
def test_edge_far_from_where_it_was_laid_is_no_fold(apart: float) -> None:
    name, reason, code = ending(apart)
    assert (name, code) == ("edges_apart", 1)
    assert f"camera and arm differ by {1e3 * apart:+.1f} mm" in reason


def test_the_worst_of_the_witnesses_names_the_end() -> None:
    off = LengthCheck("displacement", 0.0059, 0.0001)
    assert ending(0.006, off)[0] == "displacement_apart"


@pytest.mark.slow
def test_strip_that_springs_open_is_not_folded(tmp_path: Path) -> None:
    plant = DENIM.model_copy(update={"bending_length": 0.14})
    trial = Trial(plant)
    [result] = fold_all(
        [request_for("denim", "adaptive", tmp_path / "runs", trial=trial)]
    )
    assert result.exit_code == 1
    assert result.outcome == "edges_not_seen"
    assert result.edge_offset is None
    assert result.edge_offset_true == pytest.approx(-0.6, abs=0.01)
    assert read_run(Path(result.run)).result.outcome == "edges_not_seen"
    assert result.line()["like_model"] is False
