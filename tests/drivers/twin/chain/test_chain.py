"""The chain engine against the paper's numbers and against itself."""

from pathlib import Path as File

import numpy as np
import pytest

from drivers.base.errors import SimulationNotFinite
from drivers.strip.describe import describe
from drivers.strip.engine import StripMotion
from drivers.strip.file import paper_damping_minimum, paper_strip
from drivers.twin.chain.engine import Chain
from policies.path import circular, triangular
from tests.support.chain_moves import (
    LENGTH,
    SPEED,
    H,
    carry,
    displacement,
    fold,
    middling,
)


@pytest.fixture(scope="module")
def triangle() -> StripMotion:
    return fold(middling(), triangular(LENGTH))


@pytest.mark.parametrize("stiffness", [0.02, 0.0775, 0.3])
def test_a_strip_that_a_lift_pushes_back_rises_at_the_grip_and_lies_flat_elsewhere(
    stiffness: float,
) -> None:
    chain, steps = Chain(60), np.arange(1, 61) * 5e-4
    chain.reset(
        [describe(paper_strip(stiffness, 7 * paper_damping_minimum(stiffness)))]
    )
    for step in steps:
        chain.step(np.array([[LENGTH - step, step, 22.0 * step]]), H)
        x, z = chain.shapes()[0].T
        assert np.abs(z[x < LENGTH / 2]).max() < 1e-6
    assert z.max() > 0.99 * steps[-1]


def test_tip_follows_its_path_within_two_hundredths_of_a_millimetre() -> None:
    """After the jerk with which the hump that a triangular path pushes up at the grip
    lets go.
    """
    chain, path = Chain(60), triangular(LENGTH)
    chain.reset([describe(middling())])
    for travel in np.arange(0.0, 0.40, SPEED * H)[1:]:
        pose = path.poses(float(travel))
        chain.step(pose[None], H)
        if travel > 0.11:
            assert np.abs(chain.shapes()[0, -1] - pose[:2]).max() < 2e-5


def test_links_keep_their_length() -> None:
    chain = Chain(20)
    chain.reset([describe(middling())])
    carry(chain, 0.2, triangular(LENGTH))
    shape, arc = chain.shapes()[0], chain.arc()[0]
    np.testing.assert_allclose(
        np.hypot(*np.diff(shape, axis=0).T), np.diff(arc), rtol=1e-12
    )
    assert arc[-1] == pytest.approx(LENGTH)


def test_triangle_and_circle_miss_by_what_a_fine_chain_misses(
    triangle: StripMotion,
) -> None:
    """300 links at 5 ms and 240 at 2.5 ms agree on -39.95 and +68.9 mm."""
    assert displacement(triangle) == pytest.approx(-0.0400, abs=0.0025)
    assert displacement(fold(middling(), circular(LENGTH))) == pytest.approx(
        0.0689, abs=0.0025
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "factor", "triangle", "circle"),
    [(0.02, 1, -0.0291, 0.0587), (0.3, 50, -0.0502, 0.0613)],
)
def test_corners_of_the_papers_range_agree_with_a_fine_chain(
    k: float, factor: float, triangle: float, circle: float
) -> None:
    strip = paper_strip(k, factor * paper_damping_minimum(k))
    assert displacement(fold(strip, triangular(LENGTH))) == pytest.approx(
        triangle, abs=0.0025
    )
    assert displacement(fold(strip, circular(LENGTH))) == pytest.approx(
        circle, abs=0.0025
    )


@pytest.mark.slow
def test_displacement_hardly_changes_with_links_or_step(triangle: StripMotion) -> None:
    path = triangular(LENGTH)
    finer = displacement(fold(middling(), path, links=90))
    assert displacement(triangle) == pytest.approx(finer, abs=0.0015)
    quicker = displacement(fold(middling(), path, dt=H / 2))
    assert displacement(triangle) == pytest.approx(quicker, abs=0.0005)


def test_strips_of_a_batch_do_not_know_each_other() -> None:
    models = [describe(middling()), describe(middling(bending_length=0.02))]
    poses = triangular(LENGTH).poses(np.arange(H, 1.0, H) * SPEED)
    shapes = []
    for batch in (models, models[:1], models[1:]):
        chain = Chain(20)
        chain.reset(batch)
        for pose in poses:
            chain.step(np.tile(pose, (len(batch), 1)), H)
        shapes.append(chain.shapes())
    np.testing.assert_array_equal(shapes[0], np.concatenate(shapes[1:]))


@pytest.mark.parametrize("spoil", [np.nan, np.inf])
def test_divergence_is_a_fault_with_a_name_and_leaves_no_log(
    spoil: float,
    tmp_path: File,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    chain = Chain(20)
    chain.reset([describe(middling())])
    with pytest.raises(SimulationNotFinite) as fault:
        chain.step(np.array([[LENGTH, spoil, 0.0]]), H)
    assert fault.value.name == "simulation_not_finite"
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_strip_too_soft_and_undamped_for_its_pull_diverges_by_name_instead_of_nonsense():
    strip = middling(bending_length=0.012, retardation_time=0.004)
    with pytest.raises(SimulationNotFinite):
        fold(strip, circular(LENGTH), links=80)
