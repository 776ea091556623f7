"""Benchmark part: a policy over the paper's range of strips, in the rod or on the chain."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cell.benchmark.parts.recording_engine import RecordingEngine
from cell.benchmark.results import RangeFolds, finite_or_none
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from policies.domain import grid
from policies.planned import Planned
from policies.policy import Policy
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out

SEGMENTS, LINKS = 100, 80
STRIP_COST = {"rod": 0.03, "chain": 0.3}  # s of a strip
PLANNING_FOLDS = 16  # folds of the rod, about, that planning takes


@dataclass(frozen=True, slots=True)
class OverRange:
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
        recording = RecordingEngine(_engine(self.engine))
        folds = roll_out(
            knowing(self.policy, strips),
            recording,
            strips[0],
            [describe(strip) for strip in strips],
            settings=Rollout(speed=self.speed),
            rng=np.random.default_rng(0),
        )
        return RangeFolds(
            policy=self.policy,
            engine=self.engine,
            side=self.side,
            displacement=finite_or_none(folds.displacement),
            force=tuple(recording.holding_force.tolist()),
        )


def knowing(policy: str, strips: Sequence[StripFile]) -> Policy:
    """Make the policy by name; the planned one, which must know the strips, is given them."""
    return Planned(strips) if policy == Planned.name else make_policy(policy, in_rod=True)


def _engine(name: str) -> Stepper:
    if name == "rod":
        from drivers.strip.rod.engine import Rod

        return Rod(SEGMENTS, strict=False)
    from drivers.twin.chain.engine import Chain

    return Chain(LINKS)
