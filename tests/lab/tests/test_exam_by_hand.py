"""Motions by hand: no two alike, and still folds of the strip."""

from pathlib import Path

import numpy as np
import pytest

from cell.record.files import RUN
from drivers.readers import read_yaml
from policies.registry import MOTION, make_policy
from tests.lab.exam.cases import draw
from tests.lab.exam.runs import from_model, through_images
from tests.lab.exam.runs.by_hand import paths_by_hand
from tests.support.exam_cases import case

LENGTH, MANY = 0.6, 40
FASTEST = 0.4  # m/s
BENT = 8.0  # m/s^2, of a hand that starts, stops and shivers


@pytest.fixture(scope="module")
def paths():
    return paths_by_hand(LENGTH, 3, MANY)


def test_every_motion_goes_from_the_grasped_edge_to_over_the_fixed_one(paths) -> None:
    for path in paths:
        np.testing.assert_allclose(path.poses[0], [LENGTH, 0.0, 0.0], atol=1e-9)
        x, z, pitch = path.poses[-1]
        assert -1e-3 < x < 0.05 * LENGTH
        assert 0.0 < z < 0.1 * LENGTH
        assert pitch == pytest.approx(np.pi / 2)


def test_no_motion_pulls_the_strip_off_or_pushes_into_the_desk(paths) -> None:
    for path in paths:
        assert np.hypot(*path.poses[:, :2].T).max() < 1.001 * LENGTH
        assert path.poses[:, 1].min() > -1e-6
        assert path.poses[:, 1].max() > 0.35 * LENGTH


def test_a_hand_is_neither_faster_nor_rougher_than_a_hand(paths) -> None:
    for path in paths:
        velocity = np.diff(path.poses[:, :2], axis=0) / np.diff(path.t)[:, None]
        assert np.hypot(*velocity.T).max() < FASTEST
        assert np.abs(np.diff(velocity, axis=0) / np.diff(path.t)[1:, None]).max() < BENT


def test_some_rest_and_some_go_back(paths) -> None:
    speeds = [np.hypot(*np.diff(w.poses[:, :2], axis=0).T) / np.diff(w.t) for w in paths]
    resting = [float(np.mean(v[100:-100] < 0.02)) > 0.03 for v in speeds]
    back = [bool((np.diff(w.poses[:, 0])[100:-100] > 2e-4).any()) for w in paths]
    assert 0.2 < np.mean(resting) < 1.0
    assert 0.2 < np.mean(back) < 0.8


def test_the_same_seed_moves_alike_and_no_two_motions_are_alike(paths) -> None:
    again = paths_by_hand(LENGTH, 3, MANY)
    assert all(np.array_equal(a.poses, b.poses) for a, b in zip(paths, again, strict=True))
    assert len({len(path.t) for path in paths}) > MANY // 2
    other = paths_by_hand(LENGTH, 4, 1)[0]
    assert other.poses.tobytes() not in {path.poses.tobytes() for path in paths}


def test_runs_by_hand_repeat_no_condition(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(from_model, "MOTIONS", ("normal", "fast"))
    monkeypatch.setattr(from_model, "SEGMENTS", 40)
    by_hand = case("nothing", "nothing", {}).model_copy(update={"motions": "by_hand"})
    from_model.make_runs(by_hand, tmp_path)
    runs = sorted(tmp_path.iterdir())
    assert [run.name for run in runs] == ["00-by-hand", "01-by-hand"]
    heads = [read_yaml(run / RUN) for run in runs]
    assert [head["condition"] for head in heads] == ["by-hand-1", "by-hand-2"]


def test_through_images_the_cell_makes_as_many_motions_by_hand_as_standard_ones() -> None:
    standard = case("nothing", "nothing", {}).model_copy(update={"tier": "images"})
    by_hand = standard.model_copy(update={"motions": "by_hand"})
    made = through_images._requests(by_hand)
    assert len(made) == len(through_images._requests(standard))
    assert [name for name, _ in made] == [f"{i:02d}-by-hand" for i in range(len(made))]
    paths = [
        make_policy(request.policy) for _, request in made if request.policy.startswith(MOTION)
    ]
    assert len({policy.name for policy in paths}) == len(made)


def test_a_sealed_run_by_hand_states_its_number_and_no_seed() -> None:
    header = {"policy": "motion:by-hand-71-3", "condition": "motion:by-hand-71-3", "index": 3,
              "strip": "denim", "plant_sha256": "0"}  # fmt: skip
    assert through_images._sealed_header(header) == {
        "policy": "by-hand-4", "condition": "by-hand-4", "index": 3, "strip": "denim"
    }  # fmt: skip


def test_one_triple_in_three_is_moved_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(draw.SHARES, "state", {"nothing": 1.0})
    by_hand = [c.motions == "by_hand" for c in draw.cases("state", 18, 5)]
    assert by_hand == [i // 3 % 3 == 1 for i in range(18)]
    monkeypatch.setitem(draw.SHARES, "images", {"nothing": 1.0})
    assert by_hand == [c.motions == "by_hand" for c in draw.cases("images", 18, 5)]


def test_every_level_of_scatter_meets_every_strength_and_kind_of_motion() -> None:
    met = {(i % 3, (i // 3) % 3, draw._scatter_level(i)) for i in range(27)}
    assert len(met) == 27
