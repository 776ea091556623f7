"""Effects in the rod do what their laws say, as large as measured elsewhere, and
converge.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from drivers.base.geometry import arc_lengths
from drivers.base.readers import read_yaml
from drivers.strip.describe import describe
from drivers.strip.model import scale_rigidity, with_field
from drivers.strip.rod import layout as at
from drivers.strip.rod.engine import Rod
from drivers.strip.rod.lumping import lump
from drivers.twin.chain.lumps import HingeLumps, chain_nodes
from tests.support.effect_cases import LENGTH, PATHS, affected, bare, denim, folds, way
from tests.support.rod_cases import overhang, paper_model

STIFF = denim(length=0.3, bending_length=0.15)  # for a strip that hangs over an edge
WEIGHT = 0.4 * 0.05 * LENGTH * 9.81  # N


def _displacement(name: str, path: str = "triangular", **values: float) -> float:
    """How far the effect moves d [m]."""
    with_it, without = folds([affected(name, **values), bare()], path, 100)
    return with_it.touch.displacement - without.touch.displacement


def test_relaxed_strip_hangs_as_one_of_the_remaining_rigidity() -> None:
    relaxed = affected("relaxation", STIFF, ratio=0.4, time=0.5)
    straight = describe(STIFF)
    softer = scale_rigidity(straight, 0.6)
    hung, expected, before = overhang([relaxed, softer, straight])
    np.testing.assert_allclose(hung, expected, atol=1e-6)
    assert np.abs(hung - before).max() > 0.01


def test_stretched_strip_pulls_with_its_stiffness_times_its_strain() -> None:
    stiffness, error = 5.0, -0.003
    effects = {"length_error": {"error": error}, "stretch": {"stiffness": stiffness}}
    rod = Rod(60)
    rod.reset([describe(denim(effects=effects))])
    seen = rod.step(np.array([[LENGTH, 0.0, 0.0]]), 0.005)
    expected = stiffness * -error / (LENGTH + error)
    assert -seen.holding_force[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("error", [-0.004, 0.0005, 0.008])
def test_strip_starts_between_its_edges_whatever_its_length(error: float) -> None:
    rod = Rod(100)
    rod.reset([affected("length_error", error=error), bare()])
    for _ in range(100):
        rod.step(np.tile([LENGTH, 0.0, 0.0], (2, 1)), 0.005)
    shape = rod.shapes()[0]
    np.testing.assert_allclose(shape[[0, -1]], [[0.0, 0.0], [LENGTH, 0.0]], atol=1e-12)
    lengths = np.linalg.norm(np.diff(shape, axis=0), axis=1)
    assert rod.arc()[0, -1] == pytest.approx(LENGTH + error)
    assert lengths.sum() == pytest.approx(LENGTH + max(error, 0.0), rel=1e-5)
    assert (shape[:, 1].max() > 0.002) == (error > 0)
    assert (shape[shape[:, 0] < 0.4, 1] < 1e-4).all()
    np.testing.assert_allclose(rod.shapes()[1][:, 1], 0.0, atol=1e-12)


def test_longer_strip_is_laid_without_sliding_in_its_grip() -> None:
    loose = {"length_error": {"error": 0.008}, "grip_slip": {"force": 0.02}}
    rod = Rod(100)
    rod.reset([describe(denim(), loose)])
    assert arc_lengths(rod.shapes()[0])[-1] == pytest.approx(LENGTH + 0.008, rel=1e-5)


def test_loose_edge_holds_no_more_than_its_friction_and_slides_to_the_pull() -> None:
    friction = 0.4
    rod = Rod(100)
    rod.reset([affected("end_slip", friction=friction), bare()])
    path = way(PATHS["circular"])
    poses = np.stack([path.poses] * 2, axis=1)
    seen = rod.trace(poses[1:], 0.01)
    assert np.abs(seen.holding_force[:, 1]).max() > WEIGHT
    assert np.abs(seen.holding_force[:, 0]).max() < friction * WEIGHT * 1.1
    edges = rod.shapes()[:, 0, 0]
    assert edges[0] > 0.02
    assert edges[1] == 0.0
    touch = rod.touch[0]
    assert touch.to_fixed == pytest.approx(touch.x - edges[0])


def test_grip_slips_above_its_force() -> None:
    motions = folds([affected("grip_slip", force=0.3), bare()], "circular", 100)
    pulls = [-motion.holding_force.min() for motion in motions]
    assert pulls[1] > 1.0
    assert 0.2 < pulls[0] < 0.3 + WEIGHT
    slipped, held = (motion.touch for motion in motions)
    assert abs(held.extension) < 1e-6
    assert slipped.extension > 5e-4


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("seam", {"factor": 5.0, "position": 0.3, "width": 0.04}, -0.021),
        ("desk_tilt", {"angle": 0.02}, -0.004),
        ("stretch", {"stiffness": 1.0}, -0.005),
    ],
)
def test_effect_is_as_large_as_measured_elsewhere(
    name: str, values: Mapping[str, float], expected: float
) -> None:
    assert _displacement(name, **values) == pytest.approx(expected, rel=0.35)


def test_crease_up_lifts_and_crease_down_presses() -> None:
    angles = (-0.3, 0.0, 0.3)
    tips = overhang([affected("crease", STIFF, angle=a, position=0.1) for a in angles])[
        :, -1, 1
    ]
    assert tips[0] + 0.01 < tips[1] < tips[2] - 0.01


CONVERGING = read_yaml(Path(__file__).with_name("converging.yaml"))


@pytest.mark.parametrize("path", ["triangular", "circular"])
def test_effects_converge_in_elements_and_step(path: str) -> None:
    models = [affected(name, **values) for name, values in CONVERGING.items()]
    coarse, fine = folds(models, path, 100), folds(models, path, 300, 0.0025)
    for (name, _), one, two in zip(CONVERGING.items(), coarse, fine, strict=True):
        expected = two.touch
        assert one.touch.displacement == pytest.approx(
            expected.displacement, abs=6e-4
        ), name
        assert one.touch.time == pytest.approx(expected.time, abs=0.02), name


def test_friction_between_yarns_moves_the_displacement_as_measured() -> None:
    yarns = {"bending_hysteresis": {"yield_curvature": 12.0}}
    without, with_yarns = folds([paper_model(0.1), paper_model(0.1, effects=yarns)])
    moved = with_yarns.touch.displacement - without.touch.displacement
    assert moved == pytest.approx(-0.014, abs=0.006)


def test_compliant_grip_bends_in_series_with_friction_and_damping() -> None:
    laws = {"bending_hysteresis": {"yield_curvature": 12.0}}
    hard = paper_model(0.1, effects=laws | {"quadratic_damping": {"coefficient": 3e-4}})
    soft = with_field(hard, "boundary.grip_compliance", 2000.0)
    names = [at.BEND, at.STICK, at.SLIP, at.QUADRATIC]
    rod = [lump(model, 100, rich=True)[-2, names] for model in (hard, soft)]
    chain = []
    for model in (hard, soft):
        h = HingeLumps.from_model(model, chain_nodes(0.6, 100), 1.0)
        laws = h.stiffness, h.presliding, h.presliding * h.slip, h.quadratic
        chain.append(np.array(laws)[:, -1])
    for (bend, stick, slip, quadratic), found in (rod, chain):
        share = found[0] / bend
        assert found[0] == pytest.approx(1.0 / (1.0 / bend + 2000.0))
        assert found[0] + found[1] == pytest.approx(
            1.0 / (1.0 / (bend + stick) + 2000.0)
        )
        assert found[2:] == pytest.approx([share * slip, share**3 * quadratic])
