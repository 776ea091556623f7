"""The rod keeps the seam of every engine, and strips side by side do not know of each
other.
"""

from dataclasses import replace

import numpy as np
import pytest

from drivers.base.errors import SimulationNotConverged, SimulationNotFinite, Unsupported
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import Boundary
from drivers.strip.rod.batch import flat_batch
from drivers.strip.rod.engine import GripperPath, Rod, simulate_all
from drivers.strip.rod.static import fit_length
from policies.path import triangular
from tests.support.effect_cases import simulate
from tests.support.rod_cases import paper_model

DT = 0.005
PATH = triangular(0.6)


def test_strip_at_rest_does_not_move_at_all() -> None:
    rod = Rod(60)
    rod.reset([paper_model(0.05)])
    before = rod.shapes()
    rod.advance(np.repeat([[[0.6, 0.0, 0.0]]], 100, axis=0), DT)
    np.testing.assert_allclose(rod.shapes(), before, atol=1e-12)
    np.testing.assert_allclose(before[0, :, 0], rod.arc()[0], atol=1e-15)


def test_start_in_which_the_layers_touch_is_refused() -> None:
    rod = Rod(40)
    with pytest.raises(Unsupported, match="strip 0 at which its layers touch"):
        rod.reset([paper_model(0.02)], np.array([[0.3, 0.10, np.pi / 2]]))


def test_gripper_that_jerks_wildly_finds_shapes_or_says_so() -> None:
    rng = np.random.default_rng(3)
    count, steps = 24, 800
    models = [
        paper_model(*pair)
        for pair in zip(
            np.exp(rng.uniform(np.log(0.02), np.log(0.3), count)),
            np.exp(rng.uniform(0.0, np.log(50.0), count)),
            strict=True,
        )
    ]
    turns = np.repeat(rng.normal(2.6, 1.2, (steps // 40, count)), 40, axis=0)
    speed = np.repeat(rng.uniform(0.02, 0.3, (steps // 40, count)), 40, axis=0)
    x = 0.55 + np.cumsum(speed * np.cos(turns), axis=0) * DT
    z = 0.10 + np.abs(np.cumsum(speed * np.sin(turns), axis=0) * DT)
    reach = np.minimum(1.0, 0.6 / np.hypot(x, z))
    poses = np.stack([x * reach, z * reach, np.full_like(x, np.pi / 2)], axis=-1)
    rod = Rod(60)
    rod.reset(models, np.array([[0.55, 0.10, np.pi / 2]] * count))
    rod.advance(poses, DT)
    assert np.isfinite(rod.shapes()).all()


def test_pose_that_is_no_number_is_a_named_fault() -> None:
    rod = Rod(40)
    rod.reset([paper_model(0.1)])
    with pytest.raises(SimulationNotFinite, match="rod diverged"):
        rod.step(np.array([[np.nan, 0.0, 0.0]]), DT)


def test_strip_torn_from_its_grip_is_a_named_fault() -> None:
    rod = Rod(40)
    rod.reset([paper_model(0.1)] * 3)
    poses = np.array([[0.59, 0.01, 0.1], [5.0, 4.0, 9.0], [0.59, 0.01, 0.1]])
    with pytest.raises(SimulationNotConverged, match="strip 1"):
        rod.step(poses, DT)


def test_settings_and_poses_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="allowed: 20 or more"):
        Rod(5)
    rod = Rod(40)
    rod.reset([paper_model(0.1)] * 3)
    for poses in (np.zeros((2, 3)), np.zeros((3, 2))):
        with pytest.raises(ValueError, match="expected"):
            rod.step(poses, DT)


def test_gravity_that_does_not_press_on_the_desk_is_refused() -> None:
    model = replace(paper_model(0.1), boundary=Boundary(gravity=(0.0, 1.0)))
    with pytest.raises(Unsupported, match="does not press on the desk"):
        Rod(40).reset([model])


def test_motions_in_a_batch_are_those_of_one_at_a_time() -> None:
    models = [paper_model(0.05), paper_model(0.2), paper_model(0.1)]
    t = np.linspace(2.0, 10.0, 1601)
    full = GripperPath(t, PATH.poses(0.1 * (t - 2.0)))
    short = GripperPath(t[:500], full.poses[:500])
    hung = np.array([0.55, 0.10, np.pi / 2])
    lifted = GripperPath(
        t,
        hung + np.linspace(0.0, 1.0, len(t))[:, None] * [-0.1, 0.1, 0.0],
        hanging=True,
    )
    ways = [full, short, lifted]
    motions = simulate_all(Rod(40), models, ways, dt=DT, every=10)
    for motion, model, way in zip(motions[:2], models, ways, strict=False):
        alone = simulate(Rod(40), model, way.t, way.poses, dt=DT, shapes=True)
        np.testing.assert_allclose(motion.t, alone.t)
        np.testing.assert_allclose(motion.contact_x, alone.contact_x, atol=1e-9)
        np.testing.assert_allclose(motion.shapes, alone.shapes[9::10], atol=1e-9)
        assert (motion.touch is None) == (alone.touch is None)
    assert motions[0].touch.time > 7.0
    assert len(motions[2].t) == 1600
    assert np.ptp(motions[2].shapes[:2, :, 1], axis=0).max() < 0.003


STIFF_SLACK = StripFile(
    name="stiff",
    length=0.5313326547824334,
    width=0.05,
    areal_density=0.28239819853426223,
    bending_length=0.022245515947660416,
    retardation_time=0.066790626961165,
    thickness=0.0005094110801311423,
    effects={
        "bending_hysteresis": {
            "yield_curvature": 2.9846415176219834,
            "stiffness_ratio": 11.37539506008758,
        },
        "length_error": {"error": 0.0006367313215551434},
    },
)


def test_slack_strip_that_the_solver_loses_is_laid_more_slowly() -> None:
    models = [describe(STIFF_SLACK)]
    with pytest.raises(SimulationNotConverged):
        fit_length(flat_batch(models, 100), models)
    rod = Rod(100)
    rod.reset(models)
    assert np.isfinite(rod.shapes()).all()
    longer = STIFF_SLACK.length + STIFF_SLACK.effects["length_error"]["error"]
    assert rod.arc()[0, -1] == pytest.approx(longer, abs=1e-6)
