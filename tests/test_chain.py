"""The chain engine against theory, the paper's numbers, and itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from drivers.errors import SimulationNotFinite
from drivers.strip.effects import registry
from drivers.strip.engine import StripMotion, simulate
from drivers.strip.file import StripFile, paper_damping_minimum, paper_strip
from drivers.strip.model import Boundary, StripModel, describe
from drivers.strip.shape import Touch
from drivers.twin.chain import Chain
from drivers.types import Array
from policies.path import Path, circular, triangular

H = 0.005  # s
SPEED = 0.1  # m/s
LENGTH = 0.6  # m


def middling(**changes: object) -> StripFile:
    """A strip in the middle of the paper's range."""
    return paper_strip(0.0775, 7 * paper_damping_minimum(0.0775)).model_copy(update=changes)


def fold(strip: StripFile, path: Path, links: int = 60, dt: float = H) -> StripMotion:
    t = np.arange(0.0, path.length / SPEED, H)
    motion = simulate(Chain(links), describe(strip), t, path.poses(t * SPEED), dt=dt)
    assert motion.touch is not None
    return motion


def displacement(motion: StripMotion) -> float:
    assert motion.touch is not None
    return motion.touch.displacement


def carry(chain: Chain, travel: float, path: Path) -> Array:
    """Moves the gripper along `path` from its start to `travel` [m]; the pose (3,) there."""
    poses = path.poses(np.arange(H, travel / SPEED, H) * SPEED)
    for pose in poses:
        chain.step(pose[None], H)
    return np.asarray(poses[-1])


def settle(chain: Chain, pose: Array, seconds: float) -> Array:
    """Steps with the gripper at rest; the shape (nodes, 2) at the end."""
    for _ in range(round(seconds / H)):
        chain.step(pose[None], H)
    return chain.shapes()[0]


@pytest.fixture(scope="module")
def triangle() -> StripMotion:
    return fold(middling(), triangular(LENGTH))


class Laid:
    """A strip folded along the triangle, laid down about its touch, then let go."""

    def __init__(self, links: int, length: float) -> None:
        self.model = describe(paper_strip(0.1, 0.005, length=length))
        self.chain = Chain(links)
        self.chain.reset([self.model])
        self.touch, pose = self._fold(triangular(length))
        pose = self._lay(pose)
        self.held = settle(self.chain, pose, 0.5)
        self.chain.release()
        self.released = settle(self.chain, pose, 1.5)

    def _fold(self, path: Path) -> tuple[Touch, Array]:
        for pose in path.poses(np.arange(H, path.length / SPEED, H) * SPEED):
            touch = self.chain.step(pose[None], H).touch[0]
            if touch is not None:
                return touch, pose
        raise AssertionError("the layers never met")

    def _lay(self, pose: Array) -> Array:
        """Lower the edge about the touch, along a circle that grows to the layer's length."""
        x, z = pose[:2] - (self.touch.x, self.model.mechanics.touch_gap)
        start, radius = np.arctan2(z, x), np.hypot(x, z)
        for share in np.linspace(0.0, 1.0, 600):
            angle = start + share * (np.pi - start)
            reach = radius + share * (self.touch.to_grasped - radius)
            place = reach * np.array([np.cos(angle), np.sin(angle)])
            place += (self.touch.x, self.model.mechanics.touch_gap)
            pose = np.array([*place, np.pi / 2 * (1 + share)])
            self.chain.step(pose[None], H)
        return pose


@pytest.fixture(scope="module")
def laid() -> Laid:
    return Laid(links=80, length=0.4)


def test_flat_strip_stays_flat_and_still() -> None:
    chain = Chain(20)
    chain.reset([describe(middling())])
    shape = settle(chain, np.array([LENGTH, 0.0, 0.0]), 1.0)
    assert np.abs(shape[:, 1]).max() < 1e-6
    assert chain.step(np.array([[LENGTH, 0.0, 0.0]]), H).contact_x[0] == pytest.approx(LENGTH)


def test_tip_follows_its_path_within_a_tenth_of_a_millimetre() -> None:
    chain, path = Chain(60), triangular(LENGTH)
    chain.reset([describe(middling())])
    for travel in np.arange(0.0, 0.40, SPEED * H)[1:]:
        pose = path.poses(float(travel))
        chain.step(pose[None], H)
        if travel > 0.05:
            assert np.abs(chain.shapes()[0, -1] - pose[:2]).max() < 1e-4


def test_links_keep_their_length() -> None:
    chain = Chain(20)
    chain.reset([describe(middling())])
    carry(chain, 0.2, triangular(LENGTH))
    shape = chain.shapes()[0]
    np.testing.assert_allclose(np.hypot(*np.diff(shape, axis=0).T), LENGTH / 20, rtol=1e-12)
    np.testing.assert_allclose(chain.arc()[0], np.linspace(0.0, LENGTH, 21))


def test_triangle_and_circle_miss_by_what_a_fine_chain_misses(triangle: StripMotion) -> None:
    """300 links at 5 ms and 240 at 2.5 ms agree on -39.95 and +68.9 mm."""
    assert displacement(triangle) == pytest.approx(-0.0400, abs=0.0025)
    assert displacement(fold(middling(), circular(LENGTH))) == pytest.approx(0.0689, abs=0.0025)


@pytest.mark.parametrize(
    ("k", "factor", "triangle", "circle"),
    [(0.02, 1, -0.0291, 0.0587), (0.3, 50, -0.0502, 0.0613)],
)
def test_corners_of_the_papers_range_agree_with_a_fine_chain(
    k: float, factor: float, triangle: float, circle: float
) -> None:
    strip = paper_strip(k, factor * paper_damping_minimum(k))
    assert displacement(fold(strip, triangular(LENGTH))) == pytest.approx(triangle, abs=0.0025)
    assert displacement(fold(strip, circular(LENGTH))) == pytest.approx(circle, abs=0.0025)


def test_displacement_hardly_changes_with_links_or_step(triangle: StripMotion) -> None:
    path = triangular(LENGTH)
    finer = displacement(fold(middling(), path, links=90))
    assert displacement(triangle) == pytest.approx(finer, abs=0.0015)
    quicker = displacement(fold(middling(), path, dt=H / 2))
    assert displacement(triangle) == pytest.approx(quicker, abs=0.0005)


def test_light_fabric_folds_like_its_heavy_twin(triangle: StripMotion) -> None:
    light = fold(middling(areal_density=0.4), triangular(LENGTH))
    assert displacement(light) == pytest.approx(displacement(triangle), abs=1e-6)
    share = 0.4 * 0.05 / 1.65
    np.testing.assert_allclose(
        light.holding_force[100:], triangle.holding_force[100:] * share, rtol=1e-3, atol=1e-6
    )


def test_long_step_is_several_short_ones() -> None:
    chains = (Chain(20), Chain(20))
    for chain in chains:
        chain.reset([describe(middling())])
        pose = carry(chain, 0.2, triangular(LENGTH))
    one, two = chains
    move = np.array([-0.001, 0.0, 0.0])
    one.step((pose + move)[None], 2 * H)
    two.step((pose + move / 2)[None], H)
    two.step((pose + move)[None], H)
    np.testing.assert_allclose(one.shapes(), two.shapes(), atol=1e-9)


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
    assert np.hypot(*(tip - expected)) < 0.01 * np.hypot(*(expected - (strip.length, 0.0)))


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


def test_fold_at_rest_is_as_high_as_the_heavy_elastica(laid: Laid) -> None:
    c = (0.1 * 0.002 / (1.65 * 9.81)) ** (1 / 3)
    assert laid.released[:, 1].max() == pytest.approx(0.9066 * c, rel=0.03)


def test_laid_layers_rest_on_each_other_and_stay(laid: Laid) -> None:
    upper = laid.released[laid.chain.arc()[0] > 0.4 - laid.touch.to_grasped + 0.02]
    gap = laid.model.mechanics.touch_gap
    assert np.abs(upper[:, 1] - gap).max() < 0.25 * gap
    assert np.abs(laid.released - laid.held).max() < 0.5e-3


def test_edge_is_laid_off_by_the_displacement(laid: Laid) -> None:
    offset = laid.released[0, 0] - laid.released[-1, 0]
    assert offset == pytest.approx(laid.touch.displacement, abs=1e-3)


def test_released_edge_falls_to_the_desk() -> None:
    chain = Chain(20)
    chain.reset([describe(middling())])
    pose = carry(chain, 0.15, triangular(LENGTH))
    chain.release()
    assert settle(chain, pose, 1.0)[-1, 1] == pytest.approx(0, abs=1e-4)


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
    edges = np.diff(settle(chain, edge, 4.0), axis=0)
    return np.diff(np.arctan2(edges[:, 1], edges[:, 0])) / (length / links)


def test_yarn_friction_keeps_a_sharply_bent_strip_bent_at_its_yield_curvature() -> None:
    """EI kappa = friction moment = EI yield_curvature, once the friction slid back."""
    strip = paper_strip(3.0, 0.9, length=0.1)
    rubbing = strip.model_copy(update={"effects": {"bending_hysteresis": {"yield_curvature": 5.0}}})
    np.testing.assert_allclose(bent_and_let_go(describe(strip), 20.0), 0.0, atol=0.05)
    np.testing.assert_allclose(bent_and_let_go(describe(rubbing), 20.0), 5.0, rtol=0.02)


def lawful() -> list[tuple[str, float]]:
    """Low, middle and high values of every effect that changes the strip's law."""
    cases = []
    for effect in registry().values():
        switch = effect.parameters[0]
        if effect.of == "strip":
            middle = 0.5 * (switch.low + switch.high)
            cases += [(effect.name, value) for value in (switch.low, middle, switch.high)]
    return cases


@pytest.mark.parametrize(("name", "value"), lawful())
def test_effect_of_the_strip_changes_the_fold_and_keeps_it_finite(
    name: str, value: float, triangle: StripMotion
) -> None:
    effect = registry()[name]
    switch = effect.parameters[0]
    strip = middling(effects={name: effect.complete({switch.name: value})})
    motion = fold(strip, triangular(LENGTH))
    changed = not np.array_equal(motion.contact_x, triangle.contact_x)
    assert changed == (value != switch.null)


@pytest.mark.parametrize("spoil", [np.nan, np.inf])
def test_divergence_is_a_fault_with_a_name_and_leaves_no_log(
    spoil: float, tmp_path: File, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    chain = Chain(20)
    chain.reset([describe(middling())])
    with pytest.raises(SimulationNotFinite) as fault:
        chain.step(np.array([[LENGTH, spoil, 0.0]]), H)
    assert fault.value.name == "simulation_not_finite"
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_law_that_softens_without_end_diverges_by_name() -> None:
    strip = middling(effects={"nonlinear_bending": {"cubic": -1e-2}})
    with pytest.raises(SimulationNotFinite):
        fold(strip, triangular(LENGTH), links=30)


@pytest.mark.parametrize("call", [lambda: Chain(4), lambda: Chain().step(np.zeros((1, 3)), H)])
def test_wrong_calls_are_refused(call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=r"expected|allowed"):
        call()
