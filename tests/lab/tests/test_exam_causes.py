"""Hidden causes of the exam: nothing at their null, and in the chain what their laws say."""

import math
from typing import Any

import numpy as np
import pytest

from cell.config.places import find_configs
from drivers.errors import ConfigurationError
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.engine import StripMotion, simulate
from drivers.strip.model import Effects, StripModel
from drivers.twin.chain.engine import Chain
from drivers.twin.chain.forces import DahlFriction
from drivers.twin.renderer.optics import Optics
from drivers.twin.scene import Scene
from drivers.types import Array, Pose
from policies.path import triangular
from tests.lab.exam.causes import cause_of, causes
from tests.lab.exam.causes.cause import Cause
from tests.lab.exam.causes.log_creep import Fading
from tests.lab.exam.causes.sinh_bending import Excess
from tests.lab.exam.runs.specimen import Aged, Specimen
from tests.support.effect_cases import LENGTH, denim, way

LINKS, STEP = 40, 0.005
ONES = {"soft_seam", "broken_in"}  # factors, which change nothing at 1
LATE = 6  # runs that a specimen has been through before
ALIKE: dict[str, dict[str, float]] = {
    "dahl": {"yield_curvature": 3.0, "stiffness_ratio": 8.0},
    "oblique_drag": {"coefficient": 3.0},
    "sinh_bending": {"cubic": 5e-5},
    "power_damping": {"coefficient": 5e-4},
    "smooth_gradient": {"slope": 0.8},
    "soft_seam": {"factor": 1.6, "position": 0.3, "width": 0.03},
    "log_creep": {"ratio": 0.3, "time": 0.7},
}
"""Values of the effect that each cause resembles; the first one is the cause's own as well."""
LOADED: Effects = {
    "bending_hysteresis": {"yield_curvature": 2.0, "stiffness_ratio": 8.0},
    "relaxation": {"ratio": 0.2, "time": 0.5},
    "air_drag": {"coefficient": 1.5},
}


def null(name: str) -> Cause:
    return cause_of(name, {causes()[name].amount: 1.0 if name in ONES else 0.0})


def described(effects: Effects | None = None, index: int = LATE) -> StripModel:
    return describe(denim(effects=effects or {}), index=index)


def moved(plant: Any, model: StripModel, seconds: float = 20.0) -> StripMotion:
    steady = way(triangular(LENGTH))
    within = steady.t <= seconds
    return simulate(plant, model, steady.t[within], steady.poses[within], dt=STEP, shapes=True)


def lifted(*causes: Cause, index: int = LATE, seed: int = 5, seconds: float = 3.0) -> Array:
    """The shape (n, 2) after a part of the fold."""
    return moved(Specimen(LINKS, causes, seed), described(index=index), seconds).shapes[-1]


@pytest.fixture(scope="module")
def bare() -> StripMotion:
    return moved(Chain(LINKS), described())


@pytest.mark.parametrize("effects", [{}, LOADED], ids=["bare", "loaded"])
def test_causes_at_null_leave_the_chain_bit_for_bit(effects: Effects) -> None:
    model = described(effects)
    expected = moved(Chain(LINKS), model, seconds=1.5)
    found = moved(Specimen(LINKS, [null(name) for name in causes()], 1), model, seconds=1.5)
    assert np.array_equal(found.shapes, expected.shapes)


def test_touched_layers_are_those_of_a_chain_without_causes(bare: StripMotion) -> None:
    found = moved(Specimen(LINKS, [null("dahl")], 1), described())
    assert found.touch == bare.touch


@pytest.mark.parametrize("name", ALIKE)
def test_cause_changes_a_fold_like_the_effect_that_it_resembles(
    name: str, bare: StripMotion
) -> None:
    effect, values = causes()[name].answers, ALIKE[name]
    assert effect is not None
    own = {causes()[name].amount: next(iter(values.values()))}
    changed = moved(Specimen(LINKS, [cause_of(name, own)], 5), described())
    library = moved(Chain(LINKS), described({effect: values}))
    last = min(len(m.t) for m in (bare, changed, library)) - 30
    cause, known = ((m.contact_x[270:last] - bare.contact_x[270:last]) for m in (changed, library))
    cosine = cause @ known / math.sqrt((cause @ cause) * (known @ known))
    assert cosine > 0.75
    assert 0.4 < np.linalg.norm(cause) / np.linalg.norm(known) < 2.5
    assert not np.array_equal(cause, known)


def test_friction_of_dahl_dissipates_over_a_cycle_and_stays_below_its_limit() -> None:
    limit, stiffness, wide = np.array([2.0]), np.array([50.0]), 0.5
    element = DahlFriction(limit, stiffness, 1.5)
    angles = wide * np.sin(np.linspace(0.0, 6 * np.pi, 3001))
    moments = np.array([element(np.array([a]), np.zeros(1), STEP)[0][0] for a in angles])
    last = 2000  # where the last cycle begins
    middle = 0.5 * (moments[1:] + moments[:-1])
    lost = float((middle * np.diff(angles))[last:].sum())
    assert np.abs(moments).max() <= limit[0]
    assert 0.6 < lost / (4 * limit[0] * wide) < 1.0  # of what dry friction at the limit takes
    assert moments[1] == pytest.approx(stiffness[0] * angles[1], rel=0.1)  # stuck at first


def test_friction_of_dahl_does_not_depend_on_how_a_turn_is_cut() -> None:
    whole, cut = (DahlFriction(np.array([1.0]), np.array([30.0]), 1.5) for _ in range(2))
    for angle in np.linspace(0.0, 0.1, 51):
        moment = cut(np.array([angle]), np.zeros(1), STEP)[0]
    np.testing.assert_allclose(whole(np.array([0.1]), np.zeros(1), STEP)[0], moment, rtol=1e-9)


def test_creep_ends_at_the_share_that_relaxes() -> None:
    stiffness = np.array([3.0])
    fading = Fading(0.4 * stiffness / 4, np.zeros(1), np.geomspace(0.1, 2.0, 4))
    held = [fading(np.array([0.2]), np.zeros(1), STEP)[0][0] for _ in range(6000)]
    assert held[0] == pytest.approx(0.0, abs=1e-9)
    assert held[-1] == pytest.approx(-0.4 * 3.0 * 0.2, rel=1e-3)
    decades = [held[round(t / STEP)] for t in (0.1, 0.4, 1.6)]
    assert decades[1] - decades[0] == pytest.approx(decades[2] - decades[1], rel=0.35)


@pytest.mark.parametrize("hard", [True, False])
def test_smooth_stiffening_begins_like_its_cubic(hard: bool) -> None:
    bend = np.array([0.1])
    law = Excess(np.array([7.0]), bend, hard=hard)
    small = np.array([0.01])
    cubic = (1 / 6 if hard else -1 / 3) / bend**2
    moment, slope = law(small, np.zeros(1), STEP)
    np.testing.assert_allclose(moment, 7.0 * cubic * small**3, rtol=0.01)
    np.testing.assert_allclose(slope, 3 * 7.0 * cubic * small**2, rtol=0.02)


@pytest.mark.slow
def test_draught_blows_the_hanging_strip_along_and_another_seed_otherwise() -> None:
    still = lifted()
    blown = lifted(cause_of("draught", {"speed": 0.5, "gusts": 0.0}))
    against = lifted(cause_of("draught", {"speed": -0.5, "gusts": 0.0}))
    assert (blown - still)[:, 0].mean() > 1e-4 > -1e-4 > (against - still)[:, 0].mean()
    gusts = cause_of("draught", {"speed": 0.5})
    assert np.array_equal(lifted(gusts), lifted(gusts))
    assert not np.array_equal(lifted(gusts), lifted(gusts, seed=6))


def test_cling_keeps_more_of_the_strip_on_the_desk(bare: StripMotion) -> None:
    held = moved(Specimen(LINKS, [cause_of("static_cling", {"pressure": 3.0})], 5), described())
    last = min(len(held.t), len(bare.t)) - 30
    assert (held.contact_x[270:last] - bare.contact_x[270:last]).mean() > 5e-4


def test_a_sticky_patch_holds_what_lies_on_it_while_it_is_peeled(bare: StripMotion) -> None:
    patch = cause_of("sticky_patch", {"pressure": 200.0, "position": 0.7, "size": 0.06})
    held = moved(Specimen(LINKS, [patch], 5), described())
    last = min(len(held.t), len(bare.t)) - 30
    later = held.contact_x[:last] - bare.contact_x[:last]
    on, before = (np.abs(bare.contact_x[:last] - 0.7 * LENGTH) < 0.03,
                  bare.contact_x[:last] > 0.78 * LENGTH)  # fmt: skip
    assert later[on].mean() > 0.002
    assert np.abs(later[before]).max() < 1e-4


def test_a_caught_thread_pulls_the_strip_back_until_it_tears() -> None:
    weak, firm = (cause_of("caught_thread", {"strength": s}) for s in (0.002, 1.0))
    bare, torn, tied = (lifted(*some, seconds=4.5) for some in ((), (weak,), (firm,)))
    middle = round(0.7 * LINKS)
    assert tied[middle, 0] - bare[middle, 0] > 0.005
    assert np.abs(torn - bare).max() < 0.2 * np.abs(tied - bare).max()


def test_a_creeping_grip_lets_the_edge_leave_the_fingers_along_the_strip() -> None:
    creeping = cause_of("creeping_grip", {"rate": 0.001})
    held = np.array([0.5, 0.1, 0.6])
    gone = held - creeping.true_pose(held, 4.0)
    assert np.hypot(*gone[:2]) == pytest.approx(0.004)
    assert np.arctan2(gone[1], gone[0]) == pytest.approx(0.6)
    assert np.array_equal(creeping.true_pose(held, 0.0), held)


def test_specimen_changes_from_run_to_run_but_not_in_the_first() -> None:
    fresh = lifted(index=0)
    softened = cause_of("softening", {"loss": 0.92})
    broken = cause_of("broken_in", {"factor": 0.7, "first": 4})
    assert np.array_equal(lifted(softened, index=0), fresh)
    assert np.array_equal(lifted(broken, index=3), fresh)
    assert np.abs(lifted(softened, index=1) - fresh).max() > 1e-6
    assert np.abs(lifted(broken, index=4) - fresh).max() > 1e-4


def test_lost_damping_is_not_linear_in_the_runs() -> None:
    loss = cause_of("softening", {"loss": 0.8, "runs": 2.0})
    left = [
        float(loss.alter(described(index=i), np.random.default_rng()).mechanics.viscosity[0])
        for i in (0, 3, 6)
    ]
    assert left[0] - left[1] > 2 * (left[1] - left[2]) > 0


def test_humidity_is_another_in_each_run_and_the_same_when_it_is_made_again() -> None:
    damp = cause_of("humidity", {"spread": 0.2})
    shapes = [lifted(damp, index=i, seconds=2.0) for i in (0, 1, 1)]
    assert np.abs(shapes[0] - shapes[1]).max() > 1e-4
    assert np.array_equal(shapes[1], shapes[2])


def test_wobble_moves_the_edge_of_a_gripper_that_stands() -> None:
    amplitude = 0.001
    plant = Specimen(LINKS, [cause_of("wobble", {"amplitude": amplitude})], 5)
    plant.reset([described()])
    pose = np.array([[LENGTH - 0.02, 0.03, 0.5]])
    heights = []
    for _ in range(400):
        plant.step(pose, STEP)
        heights.append(plant.shapes()[0, -1, 1])
    late = np.array(heights[200:])
    assert np.ptp(late) == pytest.approx(2 * amplitude, rel=0.15)


class Still:
    """A world that is grasped at 2 s and tells when it was looked at."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def scene(self, stamp: float) -> Scene:
        self.asked.append(stamp)
        points = np.zeros((2, 2))
        return Scene(stamp, points, np.zeros(2), Pose(0, 0, 0), 0.01, holds_strip=stamp >= 2.0)


def test_clock_that_drifts_shows_an_older_world_the_longer_the_run() -> None:
    world = Still()
    seen = Aged(world, [cause_of("clock_drift", {"drift": 0.01})])
    stamps = [1.0, 2.0, 3.0, 12.0]
    shown = [seen.scene(stamp).stamp for stamp in stamps]
    assert shown == stamps  # nobody is told
    age = np.array(stamps[1:]) - world.asked[-3:]
    np.testing.assert_allclose(age, [0.0, 0.01 / 1.01, 0.1 / 1.01], atol=1e-9)


def test_touched_lens_moves_the_edge_of_the_picture_by_pixels() -> None:
    settings = find_configs(None).cell().twin.camera
    lens = cause_of("lens", {"k1": 0.1})
    now = settings.model_copy(update={"distortion": lens.distortion(settings.distortion)})
    corner, middle = np.array([[0.62, 0.3]]), np.array([[settings.aim_x, settings.aim_z]])
    before, after = Optics.of(settings), Optics.of(now)
    assert 0.5 < np.linalg.norm(after.plane(corner) - before.plane(corner)) < 8.0
    assert np.linalg.norm(after.plane(middle) - before.plane(middle)) < 0.05


def test_causes_answer_to_effects_and_are_measured_as_those_are() -> None:
    for cause in causes().values():
        assert cause.amount in cause.model_fields
        if cause.answers is not None:
            assert registry()[cause.answers].parameters[0].name == cause.amount


def test_unknown_causes_and_values_are_refused_in_a_line() -> None:
    with pytest.raises(ConfigurationError, match=r"causes: dahll: is not known; known: .*dahl"):
        cause_of("dahll", {})
    with pytest.raises(ConfigurationError, match=r"causes: dahl: yield_curvature"):
        cause_of("dahl", {"yield_curvature": -1.0})
