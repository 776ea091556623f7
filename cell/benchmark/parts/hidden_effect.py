"""Benchmark part: a policy on strips with an effect that it does not know, in the rod."""

from dataclasses import dataclass

import numpy as np

from cell.benchmark.parts.paper_range import SEGMENTS, knowing
from cell.benchmark.results import EffectFolds, finite_or_none
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.adaptive.fabrics import EFFECTS, effect, friction, plain
from policies.planned import Planned
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGE_SENSING

FRICTION_EFFECT = "bending_hysteresis"
YIELD_RANGE = (20.0, 60.0)  # 1/m, as laboratories measure it
HIDDEN_EFFECTS = ("", FRICTION_EFFECT, *EFFECTS)
"""Effects that are hidden in turn; the empty name stands for none."""
FOLD_COST, PLANNED_COST = 0.1, 5  # s of a fold; times as much where it is planned


@dataclass(frozen=True, slots=True)
class HiddenEffect:
    """Benchmark part: folds of `count` strips with a hidden `effect` at `speed` [m/s].

    The effect is of textile size. Every policy folds the same strips, observed as through images.
    """

    policy: str
    effect: str
    count: int
    speed: float
    of: str

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"{self.policy} on {self.count} strips with {self.effect or 'nothing'} hidden"

    @property
    def cost(self) -> float:
        """Estimated time [s]."""
        return self.count * FOLD_COST * (PLANNED_COST if self.policy == Planned.name else 1)

    def measure(self) -> EffectFolds:
        """Fold all strips in the rod and return their displacements [m]."""
        rng = np.random.default_rng(1)
        strips = [self._strip(rng) for _ in range(self.count)]
        known = [strip.model_copy(update={"effects": {}}) for strip in strips]
        folds = roll_out(
            knowing(self.policy, known),
            Rod(SEGMENTS, strict=False),
            known[0],
            [describe(strip) for strip in strips],
            settings=Rollout(speed=self.speed, sensing=IMAGE_SENSING),
            rng=rng,
        )
        return EffectFolds(
            policy=self.policy,
            effect=self.effect,
            displacement=finite_or_none(folds.displacement),
        )

    def _strip(self, rng: np.random.Generator) -> StripFile:
        if not self.effect:
            return plain(rng)
        if self.effect == FRICTION_EFFECT:
            return plain(rng, bending_hysteresis=friction(rng, *YIELD_RANGE))
        bare = plain(rng)
        return bare.model_copy(update={"effects": {self.effect: effect(self.effect, rng)}})
