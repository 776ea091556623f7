"""Runs of the exam through images: four files each, and nothing in them of the
plant.
"""

from pathlib import Path

import pytest
import yaml

from cell.base.config.places import find_configs
from cell.record.run import read_run
from policies.experiments.standard import STANDARD
from tests.lab.exam import through_images
from tests.lab.exam.case import Case
from tests.lab.exam.through_images import exam_cell, make_runs, plant_of
from tests.support.exam_cases import case
from tests.support.gap_strip_cases import denim

FOUR = ["profile.parquet", "result.yaml", "run.yaml", "ticks.parquet"]


def images(**causes: dict[str, float]) -> Case:
    factors = {"stiffness": 1.1, "damping": 0.8, "seed": 11, "tier": "images"}
    effects = {"pre_curl": {"curvature": 0.2}}
    return case("a-case", "outside", effects, causes=causes, answer=(), **factors)


DAHL = {"dahl": {"yield_curvature": 2.0}, "clock_drift": {"drift": 0.003}}


@pytest.fixture(scope="module")
def folded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One run of a case, made with a plant of few links."""
    folder = tmp_path_factory.mktemp("case")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(through_images, "LINKS", 40)
        make_runs(images(**DAHL), folder, 1)
    return folder


@pytest.mark.slow
def test_a_run_is_its_four_files_and_nothing_else(folded: Path) -> None:
    assert [path.name for path in folded.iterdir()] == ["00-normal"]
    assert sorted(path.name for path in (folded / "00-normal").iterdir()) == FOUR


@pytest.mark.slow
def test_a_run_can_be_read_and_ends_with_the_touch(folded: Path) -> None:
    run = read_run(folded / "00-normal")
    assert run.result.outcome == "layer_touch"
    assert run.header.condition == "motion:normal at 0.1 m/s"
    assert run.header.index == 0
    assert run.result.t_layer_touch is not None
    assert run.result.t_layer_touch < run.ticks.t[-1] < run.result.t_layer_touch + 1.5
    assert len(set(run.profile.t)) > 200


@pytest.mark.slow
def test_a_run_says_nothing_of_its_plant(folded: Path) -> None:
    header = yaml.safe_load((folded / "00-normal" / "run.yaml").read_text())
    assert {"calibration"} <= set(header) <= through_images.HEADER_KEYS
    told = b"".join(path.read_bytes() for path in (folded / "00-normal").iterdir())
    for word in (
        b"plant",
        b"seed",
        b"dahl",
        b"pre_curl",
        b"effects",
        b"bending_length",
        b"links",
    ):
        assert word not in told


def test_the_plant_has_the_base_and_effects_of_its_case() -> None:
    plant = plant_of(images(), denim())
    assert plant.bending_length == pytest.approx(1.1 * denim().bending_length)
    assert plant.retardation_time == pytest.approx(0.8 * denim().retardation_time)
    assert plant.effects == {"pre_curl": {"curvature": 0.2}}


def test_the_exam_changes_nothing_of_a_cell_but_its_plant() -> None:
    settings = find_configs(None).cell()
    for motion in STANDARD:
        changed = exam_cell(settings, motion)
        assert changed.twin.world.links >= 200
        assert changed.twin.world.step <= 0.004
        same = changed.model_copy(update={"twin": settings.twin})
        assert same == settings
        assert changed.twin.camera == settings.twin.camera
