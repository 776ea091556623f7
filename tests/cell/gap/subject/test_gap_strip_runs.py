"""Measured folds as `cell gap` reads them: whole ones, broken ones, and what is
refused.
"""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cell.gap.subject.strip import synthetic
from cell.gap.subject.strip.contradictions import contradictions
from cell.gap.subject.strip.preprocessing import images_of
from cell.record.columns import Profile
from cell.record.run import read_run
from tests.support.gap_strip_cases import denim, folds, opened, read, written
from tests.support.run_edits import edit_yaml


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("measured") / "runs"
    written(root, folds(["fast", "taut-lift"]))
    return root


@pytest.fixture
def runs(measured: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(measured, tmp_path / "runs"))


def first(runs: Path) -> Path:
    return min(runs.iterdir())


def test_images_that_follow_at_once_are_no_further_evidence() -> None:
    x = np.linspace(0.1, 0.4, 20)
    t = np.repeat([0.0, 0.01, 0.06, 0.09, 0.12], len(x))
    i, along = np.resize(np.arange(20.0), t.shape), np.resize(x, t.shape)
    profile = Profile(t=t, i=i, x=along, z=0.0 * along)
    seen = images_of(profile, np.tile([0.4, 0.0], (len(t), 1)), 0.6, 1e-3)
    assert seen.stamps.tolist() == [0.0, 0.06, 0.12]


def test_what_was_measured_comes_back_and_is_told_where_it_is_swapped(
    runs: Path,
) -> None:
    fast, taut = read(runs)
    assert fast.end == fast.touch.time
    assert taut.touch is None
    assert len(fast.contact_t) == pytest.approx(30 * fast.end, rel=0.15)
    np.testing.assert_allclose(fast.poses[0, :2], [0.6, 0.0], atol=1e-4)
    assert fast.poses[-1, 2] == pytest.approx(np.pi / 2, abs=1e-6)
    l1, l2 = fast.touch.to_fixed, fast.touch.to_grasped
    edit_yaml(first(runs) / "result.yaml", l1=l1, l2=l2, displacement=l1 - l2)
    (found,) = opened(runs).contradictions()
    assert found.what == "swapped columns"
    assert "l1 and l2 of the touches" in found.words


def test_a_run_that_died_is_named_and_used(runs: Path) -> None:
    (first(runs) / "result.yaml").unlink()
    strip = opened(runs)
    assert strip.notes[0].startswith("00-fast: died after")
    died = strip.runs[0].samples
    assert len(died) > 20
    assert "layer_touch" not in died.channel


def _hide_beginnings(run: Path, since: float, points: int) -> None:
    """Take the first `points` of every midline from a time [s] on."""
    profile = run / "profile.parquet"
    table = pq.read_table(profile)
    t, i = table["t"].to_numpy(), table["i"].to_numpy()
    pq.write_table(table.filter((t < since) | (i >= points)), profile)


def test_a_fold_is_used_up_to_a_touch_that_nobody_noted(runs: Path) -> None:
    whole, _ = read(runs)
    since = whole.end - 0.5
    fold = first(runs)
    (fold / "result.yaml").write_text("schema: 1\noutcome: path_done\n")
    _hide_beginnings(fold, since, 14)
    strip = opened(runs)
    (note,) = [note for note in strip.notes if "used up to there" in note]
    assert since - 0.2 < float(note.split("after ")[1].split(" s ")[0]) < since
    assert strip.runs[0].samples.t.max() < since


def test_midlines_whose_ends_a_hand_hides_are_not_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The way from the last point seen to the gripper is an arc, no straight line."""
    monkeypatch.setattr(synthetic, "HIDDEN_LENGTH", 0.02)
    (run,) = written(tmp_path, folds(["fast"]))
    found = contradictions(read_run(run), None, denim())
    (delay,) = [one.off for one in found if one.what.startswith("t: the midlines")]
    assert delay < 0.02


def test_a_run_that_died_at_once_is_named_and_left_out(runs: Path) -> None:
    again = shutil.copytree(first(runs), runs / "02-again")
    for name in ("ticks.parquet", "profile.parquet"):
        pq.write_table(pq.read_table(again / name).slice(0, 9), again / name)
    (again / "result.yaml").unlink()
    strip = opened(runs)
    assert [run.name for run in strip.runs] == ["00-fast", "01-taut-lift"]
    assert strip.notes == ("02-again: has 9 rows only and is left out",)


def test_two_batches_of_repeats_in_one_folder_are_two_specimens(runs: Path) -> None:
    for i, whole in enumerate(sorted(runs.iterdir())):
        again = shutil.copytree(whole, runs / f"again-{whole.name}")
        for run, seed in ((whole, i), (again, 10 + i)):
            twin = {"arm": "twin", "camera": "twin"}
            made = run / "run.yaml"
            edit_yaml(made, seed=seed, index=i, drivers=twin, plant_sha256="p")
    assert [run.index for run in read(runs) if run.usable] == [0, 0, 1, 1]
