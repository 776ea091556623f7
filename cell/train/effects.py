"""Evaluates a trained critic on unmeasured strips with each effect hidden in turn, in the rod."""

from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from drivers.strip.describe import describe
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.critic import Critic
from policies.adaptive.fabrics import CONDITIONS, STRIP_LENGTH, strip_with
from policies.adaptive.train.settings import CriticSettings
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGE_SENSING

STRIPS_PER_EFFECT = 64  # folded for each effect
EVALUATED = 4  # stream of random numbers, apart from those of the training


@dataclass(frozen=True, slots=True)
class EffectErrors:
    """Displacements (n,) [m] of strips in which `effect` is hidden; NaN without a touch."""

    effect: str
    displacement: Array

    def facts(self) -> dict[str, float | int]:
        """Bias, mean, 95 % quantile and largest |d| [m], and how many folds did not touch."""
        d, miss = self.displacement, np.abs(self.displacement)
        return {
            "strips": len(d),
            "bias": float(np.nanmean(d)),
            "mean": float(np.nanmean(miss)),
            "p95": float(np.nanquantile(miss, 0.95)),
            "worst": float(np.nanmax(miss)),
            "untouched": int(np.isnan(d).sum()),
        }


def evaluate_effects(
    critic: Critic,
    settings: CriticSettings,
    executor: Executor,
    watch: Callable[[int, int], None] = lambda _done, _pieces: None,
) -> tuple[EffectErrors, ...]:
    """Fold strips with nothing, friction and each effect hidden; the same strips for every critic.

    `watch` is called with the number of effects done and their total.
    """
    waiting = {executor.submit(fold_with, critic, settings, name): name for name in CONDITIONS}
    found: dict[str, Array] = {}
    for done in as_completed(waiting):
        found[waiting[done]] = done.result()
        watch(len(found), len(waiting))
    return tuple(EffectErrors(name, found[name]) for name in CONDITIONS)


def fold_with(critic: Critic, settings: CriticSettings, name: str) -> Array:
    """Displacements (n,) [m] of random strips with the effect `name`: a pure function."""
    rng = np.random.default_rng([EVALUATED, CONDITIONS.index(name)])
    strips = [strip_with(name, rng, STRIP_LENGTH) for _ in range(STRIPS_PER_EFFECT)]
    models = [describe(strip) for strip in strips]
    rollout = Rollout(speed=settings.speed, sensing=IMAGE_SENSING)
    rod = Rod(settings.segments, strict=False)
    with threadpool_limits(1, user_api="blas"):
        return roll_out(
            Adaptive(critic), rod, strips[0], models, settings=rollout, rng=rng
        ).displacement
