"""Runs of an exam: by hand no two alike, and as different from one another as their level says."""

from pathlib import Path

import numpy as np
import pytest

from cell.record.files import RUN, TICKS
from drivers.readers import read_yaml
from drivers.strip.describe import describe
from tests.lab.exam import cases as drawing
from tests.lab.exam import from_state, through_images
from tests.lab.exam.from_state import LEVELS, RunScatter, paths_by_hand
from tests.support.exam_cases import case
from tests.support.gap_strip_cases import denim

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


@pytest.mark.parametrize("level", ["half", "full"])
def test_runs_differ_by_as_much_as_their_level_says(level) -> None:
    drawn = [RunScatter.draw(level, 3, index) for index in range(400)]
    of = LEVELS[level]
    assert np.std([d.grip for d in drawn]) == pytest.approx(of.grip, rel=0.1)
    assert np.std([d.damping for d in drawn]) == pytest.approx(of.damping, rel=0.1)
    assert np.std([d.stiffness for d in drawn]) == pytest.approx(of.stiffness, rel=0.1)


def test_scatter_of_a_run_is_the_same_however_often_it_is_made() -> None:
    first, second = (RunScatter.draw("full", 5, 7) for _ in range(2))
    np.testing.assert_array_equal(first.grip, second.grip)
    assert (first.damping, first.stiffness) == (second.damping, second.stiffness)


def test_each_motion_is_made_as_often_as_the_case_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(from_state, "MOTIONS", ("fast",))
    monkeypatch.setattr(from_state, "SEGMENTS", 40)
    from_state.make_runs(case("nothing", "nothing", {}).model_copy(update={"repeats": 2}), tmp_path)
    assert sorted(run.name for run in tmp_path.iterdir()) == ["00-fast", "01-fast"]
    heads = [read_yaml(tmp_path / name / RUN) for name in ("00-fast", "01-fast")]
    assert [head["index"] for head in heads] == [0, 1]
    assert {head["condition"] for head in heads} == {"motion:fast"}


def test_a_chain_from_the_state_follows_the_law_of_its_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(from_state, "MOTIONS", ("fast",))
    monkeypatch.setattr(from_state, "LINKS", 40)
    plain = case("nothing", "nothing", {}).model_copy(update={"engine": "chain"})
    lawful = plain.model_copy(update={"causes": {"dahl": {"yield_curvature": 40.0}}})
    for name, made in (("plain", plain), ("again", plain), ("lawful", lawful)):
        from_state.make_runs(made, tmp_path / name)
    of = {n: (tmp_path / n / "00-fast" / TICKS).read_bytes() for n in ("plain", "again", "lawful")}
    assert of["plain"] == of["again"]
    assert of["plain"] != of["lawful"]


def test_what_a_tare_leaves_differs_from_run_to_run_and_is_none_without_force() -> None:
    plain, model = case("nothing", "nothing", {}), describe(denim())
    assert from_state.after_tare(model, plain, 0) is model
    feeling = plain.model_copy(update={"force": 0.01})
    left = [from_state.after_tare(model, feeling, i).observation for i in range(40)]
    offsets = np.array([[seen.force_x, seen.force_z] for seen in left])
    assert offsets.std(axis=0) == pytest.approx([0.01, 0.01], rel=0.4)
    assert from_state.after_tare(model, feeling, 3).observation == left[3]
