"""Parts of a benchmark over many strips in the rod or on the chain: the paper's range, effects."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cell.benchmark.results import EffectFolds, RangeFolds, finite_or_none
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.planned import Planned
from policies.registry import make_policy
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import IMAGE_SENSING
from policies.strip_sampling import EFFECTS, effect, friction, grid, plain_strip

SEGMENTS, LINKS = 100, 80
STRIP_COST = {"rod": 0.03, "chain": 0.3}  # s of a strip
PLANNING_FOLDS = 16  # folds of the rod, about, that planning takes


@dataclass(frozen=True, slots=True)
class RangePart:
    """Benchmark part: a logarithmic grid of side x side strips, folded at `speed` [m/s].

    A policy that uses images gets late and noisy observations, as in training.
    """

    policy: str
    engine: Literal["rod", "chain"]
    side: int
    speed: float
    of: str

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"{self.policy} over {self.side} x {self.side} on the {self.engine} at {self.speed}"

    @property
    def cost(self) -> float:
        """Estimated time [s]; planning takes many folds."""
        folds = self.side**2 * (PLANNING_FOLDS if self.policy == Planned.name else 1)
        return self.side**2 * STRIP_COST[self.engine] + folds * STRIP_COST["rod"]

    def measure(self) -> RangeFolds:
        """Fold all strips of the grid."""
        strips = grid(self.side)
        folds = fold_all(self.policy, strips, _engine(self.engine), Rollout(speed=self.speed))
        return RangeFolds(
            policy=self.policy,
            engine=self.engine,
            side=self.side,
            displacement=finite_or_none(folds.displacement),
            force=tuple(folds.pull.tolist()),
        )


def fold_all(
    policy: str,
    strips: Sequence[StripFile],
    engine: Stepper,
    settings: Rollout,
    *,
    known: Sequence[StripFile] = (),
    rng: np.random.Generator | None = None,
) -> Folds:
    """Fold `strips` side by side in `engine` by `policy`, which knows the files `known` of them.

    By default it knows the strips as they are, and noise is drawn from the seed 0.
    """
    known = known or strips
    decide = Planned(known) if policy == Planned.name else make_policy(policy, in_rod=True)
    models = [describe(strip) for strip in strips]
    rng = rng or np.random.default_rng(0)
    return roll_out(decide, engine, known[0], models, settings=settings, rng=rng)


def _engine(name: str) -> Stepper:
    if name == "rod":
        return Rod(SEGMENTS, strict=False)
    from drivers.twin.chain.engine import Chain

    return Chain(LINKS)


FRICTION_EFFECT = "bending_hysteresis"
YIELD_RANGE = (20.0, 60.0)  # 1/m, as laboratories measure it
HIDDEN_EFFECTS = ("", FRICTION_EFFECT, *EFFECTS)
"""Effects that are hidden in turn; the empty name stands for none."""
FOLD_COST, PLANNED_COST = 0.1, 5  # s of a fold; times as much where it is planned


@dataclass(frozen=True, slots=True)
class EffectPart:
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
        settings, engine = Rollout(speed=self.speed, sensing=IMAGE_SENSING), _engine("rod")
        folds = fold_all(self.policy, strips, engine, settings, known=known, rng=rng)
        return EffectFolds(
            policy=self.policy, effect=self.effect, displacement=finite_or_none(folds.displacement)
        )

    def _strip(self, rng: np.random.Generator) -> StripFile:
        if not self.effect:
            return plain_strip(rng)
        if self.effect == FRICTION_EFFECT:
            return plain_strip(rng, bending_hysteresis=friction(rng, *YIELD_RANGE))
        bare = plain_strip(rng)
        return bare.model_copy(update={"effects": {self.effect: effect(self.effect, rng)}})
