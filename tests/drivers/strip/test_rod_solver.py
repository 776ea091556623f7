"""The parts of the rod's solver: band factors, tangents, lumping, where code is kept."""

import numba
import numpy as np
import pytest

from drivers.strip.rod import layout as at
from drivers.strip.rod.band import eliminate, eliminate_fifth, substitute
from drivers.strip.rod.batch import flat_batch
from drivers.strip.rod.bending import internal
from drivers.strip.rod.layout import Block
from drivers.strip.rod.lumping import lattice, lump
from drivers.strip.rod.newton import assemble, desk, residual
from drivers.strip.rod.terms import air, predict_terms
from drivers.types import Array
from tests.support.rod_cases import Effects, paper_model

LAWS = {
    "nonlinear_bending": {"cubic": 1e-5},
    "bending_hysteresis": {"yield_curvature": 3.0, "stiffness_ratio": 8.0},
}
LAGGING = {
    "quadratic_damping": {"coefficient": 1e-3},
    "relaxation": {"ratio": 0.3, "time": 0.01},
    "air_drag": {"coefficient": 1e-2},
}
RATE = 300.0  # 1/s


@numba.njit(error_model="numpy")
def _solve_band(matrix: Array, side: Array, band: Array) -> None:
    for r in range(len(side)):
        row = r + 6
        a = matrix[r]
        before = (a[r - 4], a[r - 3], a[r - 2], a[r - 1])
        if r % 2 == 0:
            eliminate(band, row, before, a[r], side[r])
        else:
            eliminate_fifth(band, row, (a[r - 5], *before), a[r], side[r])
    substitute(band, 6, 6 + len(side) - 1)


def test_band_solver_solves() -> None:
    rng = np.random.default_rng(0)
    n = 24
    matrix = rng.normal(size=(n, n))
    matrix = matrix + matrix.T + 20 * np.eye(n)
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    reach = np.where(np.maximum.outer(np.arange(n), np.arange(n)) % 2 == 0, 4, 5)
    matrix[apart > reach] = 0.0
    side, band = rng.normal(size=n), np.zeros((n + 12, at.COLUMN_COUNT))
    _solve_band(matrix, side, band)
    np.testing.assert_allclose(band[6 : 6 + n, 6], np.linalg.solve(matrix, side), rtol=1e-12)


@numba.njit(error_model="numpy")
def _forces(block: Block, out: Array) -> None:
    internal(block, RATE)
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        reaction, _ = desk(block, r)
        inertia = block.nature[r, at.MASS] * RATE * RATE
        out[r, 0], out[r, 1] = residual(block, r, inertia, reaction)
        if block.terms is not None:
            (x, z), _ = air(block, r, RATE)
            out[r, 0], out[r, 1] = out[r, 0] + x, out[r, 1] + z


@numba.njit(error_model="numpy")
def _predict_terms(block: Block) -> None:
    predict_terms(block, RATE, (1.0, 0.0))


@numba.njit(error_model="numpy")
def _newton_step(block: Block) -> None:
    internal(block, RATE)
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        assemble(block, r, RATE)
    substitute(block.band, 2 * at.FIRST_FREE_NODE, 2 * block.last + 1)


def _disturbed_block(segments: int, laws: Effects, rng: np.random.Generator) -> Block:
    """A crumpled strip, partly pressed into the desk, tensions as its stretch says."""
    batch = flat_batch([paper_model(0.05, 3.0, laws)], segments)
    state = batch.state[0]
    state[:, [at.X, at.Z]] += rng.normal(size=(segments + 3, 2)) * 1e-3
    state[::4, at.Z] = 1e-5
    state[:, at.EPS] = rng.normal(size=segments + 3) * 0.1
    state[:, at.X1] = state[:, at.X]
    stretch = np.linalg.norm(np.diff(state[:, [at.X, at.Z]], axis=0), axis=1)
    rows = batch.nature[0]
    state[:-1, at.TENSION] = rows[:-1, at.STRETCH] * (stretch - rows[:-1, at.SPAN])
    rows[:, at.FLOOR] = -np.inf
    block = Block(rows, state, batch.work, batch.band, batch.last, batch.terms)
    if batch.terms is not None:
        state[:, at.MAXWELL] = rng.normal(size=segments + 3) * 0.1
        _predict_terms(block)
    return block


@pytest.mark.slow
@pytest.mark.parametrize("laws", [LAWS, LAWS | LAGGING], ids=["plain", "terms"])
def test_newton_step_is_that_of_finite_differences(laws: Effects) -> None:
    segments = 24
    block = _disturbed_block(segments, laws, np.random.default_rng(1))
    free = slice(at.FIRST_FREE_NODE, block.last + 1)

    def forces() -> Array:
        out = np.zeros((segments + 3, 2))
        _forces(block, out)
        return out[free].ravel()

    columns = []
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        for axis in (at.X, at.Z):
            here, h = block.state[r, axis], 1e-8
            block.state[r, axis] = here + h
            above = forces()
            block.state[r, axis] = here - h
            columns.append((above - forces()) / (2 * h))
            block.state[r, axis] = here
    tangent = np.stack(columns, axis=1)
    expected = np.linalg.solve(tangent, forces())
    _newton_step(block)
    step = block.band[2 * at.FIRST_FREE_NODE : 2 * block.last + 2, 6]
    np.testing.assert_allclose(step, expected, atol=1e-5 * np.abs(expected).max())


def test_lattice_grows_finer_towards_the_grip_alone() -> None:
    spans = np.diff(lattice(0.6, 100))
    np.testing.assert_allclose(spans[:89], spans[0])
    assert (np.diff(spans[89:]) < 0).all()
    assert spans[-1] < spans[0] / 6
    assert spans.sum() == pytest.approx(0.6)


def test_lumps_add_up_to_the_strip() -> None:
    model = paper_model(0.1)
    rows = lump(model, 60)[1:-1]
    mechanics = model.mechanics
    weight = 9.81 * mechanics.linear_density[0] * mechanics.length
    assert rows[:, at.MASS].sum() == pytest.approx(weight / 9.81)
    assert rows[:, at.DESK].sum() == pytest.approx(weight)
    assert (1 / rows[:, at.BEND]).sum() == pytest.approx(mechanics.length / mechanics.rigidity[0])
    retardation = mechanics.viscosity[0] / mechanics.rigidity[0]
    np.testing.assert_allclose(rows[:, at.DAMP] / rows[:, at.BEND], retardation)
