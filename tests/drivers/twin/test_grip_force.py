"""The force of a strip on its gripper: in the rod, in the chain, as the twin's arm
reports it.
"""

import numpy as np
import pytest

from cell.gap.subject.strip.synthetic import reported_path
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.engine import StripMotion
from drivers.strip.observation import mean_force
from drivers.strip.rod.engine import Rod
from drivers.strip.shape import desk_contact
from drivers.twin.arm_and_hand import ExternalWrench
from drivers.twin.chain.engine import Chain
from drivers.twin.settings import WrenchSettings
from policies.experiments.standard import STANDARD
from tests.support.effect_cases import simulate
from tests.support.twin_moves import DENIM, grasp, lift, twin_with, wait

ENGINES = {"rod": Rod(120), "chain": Chain(80)}
HEIGHT, STILL = 0.25, 2.0  # m of the gripper, s at rest there


def test_both_engines_feel_the_same_force_in_a_fold() -> None:
    path = reported_path(STANDARD["normal"].over(DENIM.length))
    rod, chain = (
        simulate(e, describe(DENIM), path.t, path.poses) for e in ENGINES.values()
    )
    t = np.arange(1.5, rod.touch.time - 0.2, 0.01)
    first, second = (at(motion, t) for motion in (rod, chain))
    assert np.sqrt(np.mean((first - second) ** 2)) < 0.0003
    assert np.abs(first - second).max() < 0.003
    assert np.abs(first).max() > 0.02


def at(motion: StripMotion, t: Array) -> Array:
    force = mean_force(motion.t, motion.grip_force)
    return np.stack([np.interp(t, motion.t, column) for column in force.T], axis=1)


def test_a_report_is_late_noisy_and_off_by_what_the_tare_left() -> None:
    def readings(seed: int, **changes: float) -> Array:
        settings = WrenchSettings(**{"noise": 1e-6, "bias": 0.0, "lag": 0.0, **changes})
        wrench = ExternalWrench(settings, np.random.default_rng(seed))
        found = []
        for _ in range(400):
            wrench.tick((0.1, -0.2))
            found.append(wrench.reading)
        return np.array(found)

    assert readings(0, noise=0.03).std(axis=0) == pytest.approx([0.03, 0.03], rel=0.15)
    assert readings(0)[-1] == pytest.approx([0.1, -0.2], abs=1e-5)
    after = readings(0, lag=0.05)[49]
    assert after == pytest.approx((1 - np.exp(-1.0)) * np.array([0.1, -0.2]), rel=1e-3)
    left = [readings(seed, bias=0.05)[-1] - [0.1, -0.2] for seed in range(40)]
    assert np.std(left) == pytest.approx(0.05, rel=0.3)


def test_the_arm_reports_force_only_where_it_is_said_to_and_nothing_else_changes():
    plain, feeling = (
        twin_with(3),
        twin_with(3, force=WrenchSettings(noise=0.001, bias=0.0)),
    )
    for twin in (plain, feeling):
        grasp(twin)
        lift(twin)
    assert plain.arm.state().pose == feeling.arm.state().pose
    assert np.isnan(plain.arm.state().force).all()
    wait(feeling, 1.0)
    lying = desk_contact(feeling.world.scene(feeling.world.time).points, 0.001)
    hanging = DENIM.length - lying
    assert feeling.arm.state().force[1] == pytest.approx(
        -DENIM.weight * hanging / DENIM.length, abs=0.2 * DENIM.weight
    )
