"""Measurements that no fold can have are refused before anything is fitted to them."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.runs import read_runs
from drivers.errors import ConfigurationError
from tests.cell.gap.subject.test_gap_strip_runs import edit_column, edit_yaml, first, put
from tests.support.gap_strip_cases import denim, folds, written


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("made") / "runs"
    written(root, folds(["fast", "taut-lift"]))
    return root


@pytest.fixture
def runs(made, tmp_path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "runs"))


def head(**changes):
    return lambda run: edit_yaml(run / "run.yaml", **changes)


def sigma(**changes):
    def change(run: Path) -> None:
        stated = yaml.safe_load((run / "run.yaml").read_text())["sigma"]
        edit_yaml(run / "run.yaml", sigma=stated | changes)

    return change


def ticks(name: str, change):
    return lambda run: edit_column(run / "ticks.parquet", name, change)


def shuffled(values: np.ndarray) -> np.ndarray:
    return np.random.default_rng(0).permutation(values)


ABSURD = {
    "a point at 1e300 m": (
        lambda run: edit_column(run / "profile.parquet", "x", put(5, 1e300)), "profile.parquet: x"),
    "a speed of 1e300 m/s": (head(speed=1e300), "run.yaml: speed"),
    "a camera of 1e300 Hz": (head(camera_hz=1e300), "run.yaml: camera_hz"),
    "an index of 1e20": (head(index=10**20), "run.yaml: index"),
    "an index of -5": (head(index=-5), "run.yaml: index"),
    "an outcome of nowhere": (
        lambda run: edit_yaml(run / "result.yaml", outcome="banana"), "result.yaml: outcome"),
    "a contact half a metre up": (head(contact_height=0.5), "run.yaml: contact_height"),
    "a pitch out of order": (ticks("pitch", shuffled), "ticks.parquet: pitch"),
    "a commanded path out of order": (ticks("x_cmd", shuffled), "ticks.parquet: x_cmd, z_cmd"),
    "a measured path out of order": (ticks("z", shuffled), "ticks.parquet: x, z"),
    "noise of a picometre": (sigma(contact_x=1e-12), "run.yaml: sigma.contact_x"),
    "noise of a picosecond": (sigma(touch_time=1e-12), "run.yaml: sigma.touch_time"),
    "no schema": (
        lambda run: (run / "run.yaml").write_text(
            (run / "run.yaml").read_text().replace("schema: 1\n", "")), "schema: is missing"),
}  # fmt: skip


@pytest.mark.parametrize("name", ABSURD)
def test_what_no_fold_can_be_is_refused_by_file_and_key(runs, name) -> None:
    spoil, says = ABSURD[name]
    spoil(first(runs))
    with pytest.raises(ConfigurationError) as caught:
        read_runs(find_runs([runs]), denim())
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_of_all_faults_are_outcomes(runs) -> None:
    for name in ("tracking_error", "arm_reflex", "camera_stalled", "interrupted", "grip_lost"):
        edit_yaml(first(runs) / "result.yaml", outcome=name)
        assert len(read_runs(find_runs([runs]), denim())) == 2


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
    read = read_runs(find_runs([runs]), denim())
    assert [run.usable for run in read] == [True, False, True, False]
    assert "is the same fold of the twin as" in read[1].notes[0]


def test_two_runs_of_one_index_by_a_laboratory_are_still_refused(runs) -> None:
    name = first(runs).name
    edit_yaml(runs / name / "run.yaml", index=0)
    shutil.copytree(runs / name, runs / "again")
    with pytest.raises(ConfigurationError, match="give each run of a specimen its own"):
        read_runs(find_runs([runs]), denim())
