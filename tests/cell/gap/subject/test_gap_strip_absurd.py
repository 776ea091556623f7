"""Measurements that no fold can have are refused before anything is fitted to them."""

import shutil
from pathlib import Path

import pytest

from cell.gap.subject.run_folders import counted_once, find_runs
from cell.gap.subject.strip.runs import read_runs
from tests.cell.gap.subject.test_gap_strip_runs import edit_yaml
from tests.support.gap_strip_cases import denim, folds, written


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("made") / "runs"
    written(root, folds(["fast", "taut-lift"]))
    return root


@pytest.fixture
def runs(made, tmp_path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "runs"))


def cells_own(run: Path, seed: int, index: int, plant: str = "p") -> None:
    made = {"drivers": {"arm": "twin", "camera": "twin"}, "plant_sha256": plant}
    edit_yaml(run / "run.yaml", seed=seed, index=index, **made)


def test_two_batches_of_repeats_in_one_folder_are_two_specimens(runs) -> None:
    for i, name in enumerate(sorted(path.name for path in runs.iterdir())):
        shutil.copytree(runs / name, runs / f"again-{name}")
        cells_own(runs / name, seed=i, index=i)
        cells_own(runs / f"again-{name}", seed=10 + i, index=i)
    read = read_runs(find_runs([runs]), denim())
    assert [run.measured.index for run in read] == [0, 0, 1, 1]
    assert all(run.usable for run in read)


def test_a_fold_made_twice_from_one_seed_counts_once(runs) -> None:
    for i, name in enumerate(sorted(path.name for path in runs.iterdir())):
        cells_own(runs / name, seed=i, index=i)
        shutil.copytree(runs / name, runs / f"z-again-{name}")
    kept, copies = counted_once(find_runs([runs]))
    assert [run.measured.index for run in read_runs(kept, denim())] == [0, 1]
    assert set(copies) == {"z-again-00-fast", "z-again-01-taut-lift"}
