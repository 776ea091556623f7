"""Slack strips laid flat on several grids: `python -m tests.lab measure-slack`.

Each strip file is drawn COUNT times, 0.5 to 4 mm longer than stated. Slack makes a wave at the
grip, equally high on every grid, or stays straight where compression takes up all of it. Counted
are strips that the rod loses, straight ones, and waves over 1 mm from those of the finest grid.
"""

import sys

import numpy as np

from cell.config.places import find_configs
from drivers.errors import SimulationNotConverged
from drivers.strip.describe import describe
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from tests.lab.exam.from_state import scale_strip

COUNT, SEED, GRIDS = 20, 3, (60, 120, 240, 480)
FINE = 120  # segments from which grids have to agree
STRAIGHT, EQUAL = 1e-4, 1e-3  # [m], heights of a wave


def draw() -> list[StripModel]:
    """COUNT stretchable slack strips of each strip file."""
    configs, rng = find_configs(None), np.random.default_rng(SEED)
    models = []
    for name in (name for name in configs.strip_names() for _ in range(COUNT)):
        stiffness, damping = rng.uniform(0.8, 1.25), rng.uniform(0.5, 2.0)
        error, stretch = rng.uniform(0.5e-3, 4e-3), rng.uniform(4.0, 60.0)
        strip = scale_strip(configs.strip(name), stiffness, damping)
        effects = {"length_error": {"error": error}, "stretch": {"stiffness": stretch}}
        models.append(describe(strip, effects, 0))
    return models


def height(model: StripModel, segments: int) -> float:
    """Height [m] of the wave of one strip at rest; NaN where the rod finds no shape."""
    rod = Rod(segments)
    try:
        rod.reset([model])
    except SimulationNotConverged:
        return float("nan")
    return float(rod.shapes()[0, :, 1].max())


def main() -> int:
    """Print the counts of every grid; 1 where a strip is lost, or fine grids do not agree."""
    models = draw()
    heights = np.array([[height(m, segments) for m in models] for segments in GRIDS])
    lost, straight = np.isnan(heights), heights < STRAIGHT
    apart = np.abs(heights - heights[-1]) > EQUAL
    for row, segments in enumerate(GRIDS):
        sys.stdout.write(
            f"{segments} segments: of {len(models)} strips {lost[row].sum()} lost, "
            f"{straight[row].sum()} straight, {apart[row].sum()} over 1 mm from {GRIDS[-1]}\n"
        )
    return int(lost.any() or apart[np.array(GRIDS) >= FINE].any())
