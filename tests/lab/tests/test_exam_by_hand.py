"""Motions by hand: no two alike, and still folds of the strip."""

from pathlib import Path

import numpy as np
import pytest

from cell.record.files import RUN
from drivers.readers import read_yaml
from tests.lab.exam import cases as drawing
from tests.lab.exam import from_state, through_images
from tests.lab.exam.from_state import paths_by_hand
from tests.support.exam_cases import case

LENGTH, MANY = 0.6, 40


@pytest.fixture(scope="module")
def paths():
    return paths_by_hand(LENGTH, 3, MANY)


def test_no_motion_pulls_the_strip_off_or_pushes_into_the_desk(paths) -> None:
    for path in paths:
        assert np.hypot(*path.poses[:, :2].T).max() < 1.001 * LENGTH
        assert path.poses[:, 1].min() > -1e-6
        assert path.poses[:, 1].max() > 0.35 * LENGTH


def test_the_same_seed_moves_alike_and_no_two_motions_are_alike(paths) -> None:
    again = paths_by_hand(LENGTH, 3, MANY)
    assert all(np.array_equal(a.poses, b.poses) for a, b in zip(paths, again, strict=True))
    assert len({len(path.t) for path in paths}) > MANY // 2
    other = paths_by_hand(LENGTH, 4, 1)[0]
    assert other.poses.tobytes() not in {path.poses.tobytes() for path in paths}


def test_runs_by_hand_repeat_no_condition(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(from_state, "MOTIONS", ("normal", "fast"))
    monkeypatch.setattr(from_state, "SEGMENTS", 40)
    by_hand = case("nothing", "nothing", {}).model_copy(update={"motions": "by_hand"})
    from_state.make_runs(by_hand, tmp_path)
    runs = sorted(tmp_path.iterdir())
    assert [run.name for run in runs] == ["00-by-hand", "01-by-hand"]
    heads = [read_yaml(run / RUN) for run in runs]
    assert [head["condition"] for head in heads] == ["by-hand-1", "by-hand-2"]


def test_a_sealed_run_by_hand_states_its_number_and_no_seed() -> None:
    header = {"policy": "motion:by-hand-71-3", "condition": "motion:by-hand-71-3", "index": 3,
              "strip": "denim", "plant_sha256": "0"}  # fmt: skip
    assert through_images._sealed_header(header) == {
        "policy": "by-hand-4", "condition": "by-hand-4", "index": 3, "strip": "denim"
    }  # fmt: skip


def test_one_triple_in_three_is_moved_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(drawing.SHARES, "state", {"nothing": 1.0})
    by_hand = [c.motions == "by_hand" for c in drawing.cases("state", 18, 5)]
    assert by_hand == [i // 3 % 3 == 1 for i in range(18)]
    monkeypatch.setitem(drawing.SHARES, "images", {"nothing": 1.0})
    assert by_hand == [c.motions == "by_hand" for c in drawing.cases("images", 18, 5)]


def test_every_level_of_scatter_meets_every_strength_and_kind_of_motion() -> None:
    met = {(i % 3, (i // 3) % 3, drawing._scatter_level(i)) for i in range(27)}
    assert len(met) == 27
