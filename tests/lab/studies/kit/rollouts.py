"""Folds by `adaptive` from noisy states, on rod or chain, with its predictions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drivers.base.types import Array
from drivers.strip.engine import Observables, Stepper
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from policies.adaptive.adaptive import Adaptive
from policies.policy import Decision, FoldPrediction, Observation
from policies.sensing import IMAGE_SENSING, Sensing
from policies.strip_sampling import STRIP_LENGTH, draw_friction, plain_strip

LOUD = replace(IMAGE_SENSING, contact_sigma=0.003, tip_sigma=0.003, profile_sigma=0.003)
Draw = Callable[[np.random.Generator], StripFile]


class Kept(Adaptive):
    """Policy `adaptive` for one strip that keeps every observation and the prediction
    after it.
    """

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Discard the observations of the last fold."""
        super().reset(strip, speed, count)
        self.seen: list[tuple[Observation, FoldPrediction]] = []

    def decide(self, observation: Observation) -> Decision:
        """Decide, and keep observation and prediction."""
        decision = super().decide(observation)
        judged = self._recent[-1]
        d, sigma, belief = (
            judged.displacement[0],
            judged.sigma[0],
            judged.belief.first(),
        )
        prediction = FoldPrediction(float(d), float(sigma), **belief, blind=False)
        self.seen.append((observation, prediction))
        return decision


class Traced:
    """Engine wrapper that records the grippers' motion: `times` (k,) [s], `poses` (k,
    n, 3).
    """

    def __init__(self, engine: Stepper) -> None:
        self._engine = engine
        self.times: list[float] = []
        self.poses: list[Array] = []

    def reset(self, models: Sequence[StripModel]) -> None:
        """Start a new recording."""
        self._engine.reset(models)
        self.times, self.poses = (
            [0.0],
            [np.tile((STRIP_LENGTH, 0.0, 0.0), (len(models), 1))],
        )

    def step(self, poses: Array, dt: float) -> Observables:
        """Step the engine to `poses` (n, 3) in `dt` [s], and record that."""
        self.times.append(self.times[-1] + dt)
        self.poses.append(poses.copy())
        return self._engine.step(poses, dt)

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] of the engine."""
        return self._engine.shapes()

    def arc(self) -> Array:
        """Arc lengths (n, nodes) [m] of the engine."""
        return self._engine.arc()


def rough(low: float, high: float) -> Draw:
    """Make a draw function of strips with yarn friction, its yield curvature in a range
    [1/m].
    """
    return lambda rng: plain_strip(
        rng, bending_hysteresis=draw_friction(rng, low, high)
    )


def stretchy(rng: np.random.Generator) -> StripFile:
    """Draw a strip that stretches far more than fabric."""
    return plain_strip(rng, stretch={"stiffness": 3.0})


def sensing_of(name: str) -> Sensing:
    """Simulated sensing in the condition called `name`: as through images where not
    named.
    """
    late = {
        f"latency +-{ms} ms": replace(IMAGE_SENSING, delay_error=1e-3 * ms)
        for ms in (10, 30)
    }
    half = replace(IMAGE_SENSING, dropped=(0.5, 0.5))
    known: Mapping[str, Any] = {"3 mm noise": LOUD, "half dropped": half, **late}
    found: Sensing = known.get(name, IMAGE_SENSING)
    return found
