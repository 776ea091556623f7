"""Plants that come with the cell: fabrics as laboratories measured them, beside what it
knows.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from cell.base.config.places import find_configs
from drivers.strip.describe import load_plant
from drivers.strip.file import StripFile

CONFIGS = find_configs(None)
PLANTS = sorted((CONFIGS.folder / "plants").glob("*.yaml"))
YIELD = "effects.bending_hysteresis.yield_curvature"
PAIR = re.compile(r"(\d+\.\d+)/(\d+\.\d+)")  # 2HB [gf cm/cm] over B [gf cm^2/cm]
FORCE, LENGTH = 9.80665e-3, 1e-2  # N, m: one gf and one cm


def loaded(path: Path) -> tuple[StripFile, StripFile]:
    plant = load_plant(path)
    return plant, CONFIGS.strip(plant.name)


@pytest.mark.parametrize("path", PLANTS, ids=lambda path: path.stem)
def test_a_plant_differs_from_its_strip_by_effects_unknown_to_the_file(
    path: Path,
) -> None:
    plant, strip = loaded(path)
    assert path.stem == plant.name
    assert not strip.effects
    assert plant.effects
    same = plant.model_copy(update={"effects": {}, "provenance": strip.provenance})
    assert same == strip


@pytest.mark.parametrize("path", PLANTS, ids=lambda path: path.stem)
def test_friction_is_half_the_published_loop_over_the_published_rigidity(
    path: Path,
) -> None:
    plant, _ = loaded(path)
    (entry,) = (entry for entry in plant.provenance if entry.key == YIELD)
    pairs = np.array([[float(x) for x in pair] for pair in PAIR.findall(entry.note)])
    if entry.source == "assumed":
        assert not len(pairs)
        return
    loop = pairs[:, 0] * FORCE * LENGTH / LENGTH  # N m/m
    rigidity = pairs[:, 1] * FORCE * LENGTH**2 / LENGTH  # N m^2/m
    published = float(np.median(loop / 2 / rigidity))
    stated = plant.effects["bending_hysteresis"]["yield_curvature"]
    assert stated == pytest.approx(published, rel=0.005)
