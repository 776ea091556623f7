"""The rod against theory, against itself refined, and against the numbers of the
paper's range.
"""

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod import layout as at
from drivers.strip.rod.engine import Rod
from drivers.strip.rod.lumping import lattice, lump
from policies.path import Path, circular, triangular
from tests.support.elastica import heavy_elastica
from tests.support.rod_cases import (
    for_all,
    overhang,
    paper_grid,
    steady,
)

BENDING_LENGTHS = (0.0135, 0.02, 0.0333)


def _fabric(
    bending_length: float, length: float, retardation: float = 0.05
) -> StripFile:
    return StripFile(
        name="fabric",
        length=length,
        width=0.05,
        areal_density=0.4,
        bending_length=bending_length,
        retardation_time=retardation,
    )


@pytest.mark.parametrize("length", [0.1, 0.25])
def test_cantilever_hangs_along_the_heavy_elastica(length: float) -> None:
    shapes = overhang([describe(_fabric(c, length)) for c in BENDING_LENGTHS])
    for shape, c in zip(shapes, BENDING_LENGTHS, strict=True):
        exact = heavy_elastica(lattice(length, 100), c)
        assert np.linalg.norm(shape - exact, axis=1).max() < 0.002 * length


def _displacements(path: Path, segments: int, dt: float) -> Array:
    rod = Rod(segments)
    rod.reset(paper_grid())
    rod.advance(for_all(steady(path, dt), 25), dt)
    return np.array([touch.displacement for touch in rod.touch if touch])


@pytest.mark.parametrize(
    ("path", "mean", "low", "high"),
    [(triangular(0.6), -0.040, -0.054, -0.029), (circular(0.6), 0.066, 0.046, 0.087)],
    ids=["triangular", "circular"],
)
def test_displacements_are_those_of_the_paper_and_converged(
    path: Path, mean: float, low: float, high: float
) -> None:
    exact = _displacements(path, 300, 0.0025)
    assert exact.mean() == pytest.approx(mean, abs=0.001)
    assert exact.min() == pytest.approx(low, abs=0.001)
    assert exact.max() == pytest.approx(high, abs=0.001)
    error = np.abs(_displacements(path, 100, 0.005) - exact)
    assert error.mean() < 0.0003
    assert error.max() < 0.0008


def _swing(dt: float) -> tuple[Array, Array]:
    """Energy [J] (k,) of a hanging strip pushed for 0.4 s, and what viscosity took,
    from 0.5 s.
    """
    model, segments = describe(_fabric(0.0233, 0.6, 0.004)), 60
    hung = np.array([0.45, 0.25, np.pi / 2])
    rod = Rod(segments)
    rod.reset([model], hung[None])
    t = np.arange(1, round(1.5 / dt) + 1) * dt
    push = 0.04 * np.sin(np.pi * np.clip(t / 0.4, 0.0, 1.0)) ** 2
    poses = hung + push[:, None] * np.array([1.0, 0.0, 0.0])
    shapes = rod.trace(poses[:, None], dt, every=1).shapes[:, 0]
    rows, v = lump(model, segments)[1:-1], np.gradient(shapes, dt, axis=0)
    strain = _strains(shapes)
    energy = (
        rows[:, at.MASS] * (0.5 * (v**2).sum(axis=-1) + 9.81 * shapes[:, :, 1])
        + 0.5 * rows[:, at.BEND] * strain**2
    ).sum(axis=-1)
    power = (rows[:, at.DAMP] * np.gradient(strain, dt, axis=0) ** 2).sum(axis=-1)
    begin = round(0.5 / dt)
    return energy[begin:], np.cumsum(power[begin:]) * dt


def _strains(shapes: Array) -> Array:
    """4 tan(theta / 4) at every node (k, nodes), the ends clamped flat and upright."""
    edges = np.diff(shapes, axis=1)
    flat, upright = (
        np.broadcast_to(u, (len(shapes), 1, 2)) for u in ([1.0, 0.0], [0.0, 1.0])
    )
    edges = np.concatenate([flat, edges, upright], axis=1)
    angle = np.unwrap(np.arctan2(edges[:, :, 1], edges[:, :, 0]), axis=1)
    return np.asarray(4 * np.tan(np.diff(angle, axis=1) / 4))


def test_free_swing_loses_the_energy_that_viscosity_dissipates() -> None:
    energy, taken = _swing(0.0005)
    assert energy[0] - energy[-1] == pytest.approx(taken[-1], rel=0.06)
    assert np.diff(energy).max() < 0.01 * (energy[0] - energy[-1])
