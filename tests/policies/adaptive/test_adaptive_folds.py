"""The policy `adaptive` folds strips that nobody measured, with images as they are."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.rod.engine import Rod
from policies.adaptive.adaptive import BLIND_RISE, Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.policy import Observation
from policies.registry import make_policy
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import IMAGE_SENSING, Sensing
from policies.strip_sampling import draw_friction, plain_strip

pytestmark = pytest.mark.slow

COUNT = 24


def folded(
    policy: object, sensing: Sensing = IMAGE_SENSING, *, rough: bool = False
) -> Folds:
    rng = np.random.default_rng(5)
    rubs = [
        {"bending_hysteresis": draw_friction(rng, 20, 60)} for _ in range(COUNT * rough)
    ]
    strips = [plain_strip(rng, **effects) for effects in rubs or [{}] * COUNT]
    models = [describe(strip) for strip in strips]
    settings = Rollout(sensing=sensing)
    rod = Rod(100, strict=False)
    return roll_out(policy, rod, strips[0], models, settings=settings, rng=rng)


@pytest.mark.parametrize("rough", [False, True], ids=["smooth", "yarn friction"])
def test_unknown_strips_end_within_two_millimetres_in_the_mean(rough: bool) -> None:
    folds = folded(make_policy("adaptive", in_rod=True), rough=rough)
    assert folds.touched.all()
    miss = np.abs(folds.displacement)
    assert miss.mean() < 0.002
    assert miss.max() < 0.006


def test_half_the_images_dropped_or_three_millimetres_of_noise_end_no_fold() -> None:
    loud = replace(
        IMAGE_SENSING, contact_sigma=0.003, tip_sigma=0.003, profile_sigma=0.003
    )
    for sensing in (replace(IMAGE_SENSING, dropped=(0.5, 0.5)), loud):
        folds = folded(make_policy("adaptive", in_rod=True), sensing)
        assert folds.touched.all()
        assert np.abs(folds.displacement).mean() < 0.0035


def observed(time: float, x: float, profile: Array) -> Observation:
    one = np.ones(1)
    return Observation(
        time=time * one,
        x=x * one,
        z=0.2 * one,
        stamp=(time - 0.03) * one,
        contact_x=profile[0, 0, 0] * one,
        tip_x=0.5 * one,
        tip_z=0.05 * one,
        profile=profile,
        profile_confidence=one,
    )


def test_policy_that_sees_nothing_holds_its_line_and_then_takes_that_of_shifted():
    policy = Adaptive(load_critic())
    strip = plain_strip(np.random.default_rng(0))
    policy.reset(strip, 0.1, 1)
    steps = np.linspace(0.0, 1.0, 12)[:, None]
    seen = (np.array([0.45, 0.001]) + steps * np.array([-0.05, 0.2]))[None]
    nothing = np.full_like(seen, np.nan)
    for k in range(20):
        policy.decide(observed(k / 60, 0.4, seen))
    assert not policy.blind[0]
    for k in range(20, 120):
        policy.decide(observed(k / 60, 0.4, nothing))
    assert policy.blind[0]
    assert policy.prediction().blind
    assert policy.rise[0] == pytest.approx(BLIND_RISE * strip.length, abs=1e-4)


def test_fold_of_a_batch_is_the_fold_of_one() -> None:
    rng = np.random.default_rng(3)
    strips = [plain_strip(rng) for _ in range(3)]

    def displaced(chosen: list) -> Array:
        exact = replace(
            IMAGE_SENSING, contact_sigma=0, tip_sigma=0, profile_sigma=0, tip_z_sigma=0
        )
        still = replace(
            exact,
            contact_bias=0,
            tip_bias=0,
            profile_bias=0,
            wild=0,
            delay=(0.03, 0.03),
        )
        still = replace(still, delay_error=0)
        rod = Rod(60, strict=False)
        models = [describe(strip) for strip in chosen]
        settings = Rollout(sensing=still)
        return roll_out(
            make_policy("adaptive"), rod, strips[0], models, settings=settings, rng=rng
        ).displacement

    assert displaced(strips)[1] == pytest.approx(displaced(strips[1:2])[0], abs=1e-6)
