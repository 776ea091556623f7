"""The chain against closed forms: heavy elastica, weight, friction of yarns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import paper_strip
from drivers.strip.model import Boundary, StripModel
from drivers.twin.chain.engine import Chain
from tests.support.chain_moves import LENGTH, H, middling, settle


def test_clamped_strip_bends_as_the_heavy_elastica() -> None:
    """Clamped flat under gravity turned upwards, three bending lengths long."""
    strip = paper_strip(0.3, 0.03, length=0.1)
    model = describe(strip)
    up = replace(model, boundary=Boundary(gravity=(0.0, -model.boundary.gravity[1])))
    chain = Chain(80)
    chain.reset([up])
    chain.release()
    tip = settle(chain, np.zeros(3), 3.0)[-1]
    expected = heavy_elastica(strip.length, strip.bending_length)
    assert np.hypot(*(tip - expected)) < 0.01 * np.hypot(
        *(expected - (strip.length, 0.0))
    )


def heavy_elastica(length: float, bending_length: float) -> Array:
    """Tip (2,) of EI theta'' = -w (L - s) cos(theta), theta(0) = 0, theta'(L) = 0."""

    def slope(s: Array, y: Array) -> Array:
        bend = -(length - s) * np.cos(y[0]) / bending_length**3
        return np.array([y[1], bend, np.cos(y[0]), np.sin(y[0])])

    def ends(a: Array, b: Array) -> Array:
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, length, 101)
    start = np.stack([s / length, np.ones_like(s) / length, s, s / 2])
    solution = solve_bvp(slope, ends, s, start, tol=1e-8)
    return np.array(solution.y[2:, -1])


def test_fixed_edge_holds_what_pulls_along_the_desk() -> None:
    model = describe(middling())
    tilted = replace(model, boundary=Boundary(gravity=(0.5, -9.8)))
    chain = Chain(20)
    chain.reset([tilted])
    chain.release()
    settle(chain, np.zeros(3), 1.0)
    held = chain.step(np.zeros((1, 3)), H).holding_force[0]
    assert held == pytest.approx(-0.5 * 1.65 * LENGTH, rel=1e-3)


def bent_and_let_go(model: StripModel, curvature: float) -> Array:
    """Curvatures at the inner hinges [1/m] that a weightless strip keeps."""
    length, links = model.mechanics.length, 20
    afloat = replace(model, boundary=Boundary(gravity=(0.0, 0.0)))
    chain = Chain(links)
    chain.reset([afloat])
    for kappa in np.linspace(0.0, curvature, 200)[1:]:
        turn = kappa * length
        edge = np.array([np.sin(turn) / kappa, (1 - np.cos(turn)) / kappa, turn])
        chain.step(edge[None], H)
    chain.release()
    edges, spans = np.diff(settle(chain, edge, 4.0), axis=0), np.diff(chain.arc()[0])
    turns = np.diff(np.arctan2(edges[:, 1], edges[:, 0]))
    return np.asarray(turns / (0.5 * (spans[1:] + spans[:-1])))


def test_yarn_friction_keeps_a_sharply_bent_strip_bent_at_its_yield_curvature() -> None:
    """EI kappa = friction moment = EI yield_curvature, once the friction slid back."""
    strip = paper_strip(3.0, 0.9, length=0.1)
    rubbing = strip.model_copy(
        update={"effects": {"bending_hysteresis": {"yield_curvature": 5.0}}}
    )
    np.testing.assert_allclose(bent_and_let_go(describe(strip), 20.0), 0.0, atol=0.05)
    np.testing.assert_allclose(bent_and_let_go(describe(rubbing), 20.0), 5.0, rtol=0.02)
