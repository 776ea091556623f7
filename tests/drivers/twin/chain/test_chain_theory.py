"""The chain against closed forms: heavy elastica, weight, friction of yarns."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import paper_strip
from drivers.strip.model import Boundary, StripModel
from drivers.twin.chain.engine import Chain
from tests.support.chain_moves import LENGTH, H, middling, settle
from tests.support.elastica import heavy_elastica


def test_clamped_strip_bends_as_the_heavy_elastica() -> None:
    """Clamped flat under gravity turned upwards, three bending lengths long."""
    strip = paper_strip(0.3, 0.03, length=0.1)
    model = describe(strip)
    up = replace(model, boundary=Boundary(gravity=(0.0, -model.boundary.gravity[1])))
    chain = Chain(80)
    chain.reset([up])
    chain.release()
    tip = settle(chain, np.zeros(3), 3.0)[-1]
    arc = np.linspace(0.0, strip.length, 101)
    expected = heavy_elastica(arc, strip.bending_length)[-1] * (1, -1)
    deflection = np.hypot(*(expected - (strip.length, 0.0)))
    assert np.hypot(*(tip - expected)) < 0.01 * deflection


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
