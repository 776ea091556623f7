"""Motions written down, the standard ones among them, and the policy that makes
them.
"""

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.strip.describe import describe, load_strip
from drivers.strip.rod.engine import Rod
from policies.experiments.motion import FASTEST_COMMAND, Go, Rest, motion
from policies.experiments.standard import STANDARD
from policies.path import triangular
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING
from tests.support.gap_strip_cases import STRIP

SPEED = 0.1


def test_a_motion_goes_there_and_back_and_waits() -> None:
    path = triangular(0.6)
    made = motion(path, (Go(0.5), Go(0.25), Rest(1.0), Go(1.0)), SPEED)
    half, quarter = 0.5 * path.length, 0.25 * path.length
    assert made.duration == pytest.approx(
        (half + quarter + 0.75 * path.length) / SPEED + 1.0
    )
    np.testing.assert_allclose(made.at(half / SPEED), path.at(half))
    back = (half + quarter) / SPEED
    np.testing.assert_allclose(
        made.at(np.array([back, back + 0.9])), path.at([quarter, quarter])
    )
    np.testing.assert_allclose(made.at(made.duration), path.points[-1])


@pytest.mark.parametrize("name", STANDARD)
def test_the_policy_makes_its_motion(name: str) -> None:
    strip = load_strip(STRIP)
    standard = STANDARD[name]
    policy = make_policy(f"motion:{name}")
    assert policy.name == f"motion:{name}"
    settings = Rollout(speed=standard.speed, sensing=EXACT_SENSING, patience=4.0)
    made = roll_out(
        policy,
        Rod(60),
        strip,
        [describe(strip)] * 2,
        settings=settings,
        rng=np.random.default_rng(0),
    )
    trace = made.trace[:, 0]
    planned = standard.over(strip.length).at(np.arange(0.0, 40.0, 0.005))
    away = np.linalg.norm(trace[:, None] - planned[None], axis=2).min(axis=1)
    assert away.max() < 0.006
    assert made.touched.all() == (name != "taut-lift")
    step = np.linalg.norm(np.diff(trace, axis=0), axis=1).max() * settings.rate
    assert step < 1.1 * FASTEST_COMMAND


def test_an_unknown_motion_names_the_known_ones() -> None:
    with pytest.raises(ConfigurationError, match="motion:normal"):
        make_policy("motion:nowhere")
