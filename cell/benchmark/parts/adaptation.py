"""Benchmark part: dependence of a policy's path on the stiffness of the strip."""

from dataclasses import dataclass

import numpy as np

from cell.benchmark.parts.evolution import curve
from cell.benchmark.parts.paper_range import knowing
from cell.benchmark.results import Adaptation, finite_or_none
from drivers.strip.describe import describe
from drivers.strip.rod.engine import Rod
from policies.domain import strip_at
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING

STIFFNESSES = 7
DAMPING_SHARE = 0.3  # place in the paper's range


@dataclass(frozen=True, slots=True)
class Adapted:
    """Benchmark part: gripper paths of `policy` over the paper's range of stiffness."""

    policy: str
    speed: float
    of: str
    cost: float = 1.0

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"adaptation of {self.policy} at {self.speed}"

    def measure(self) -> Adaptation:
        """Fold one strip of each stiffness, with exact observations."""
        strips = [strip_at(u, DAMPING_SHARE) for u in np.linspace(0.0, 1.0, STIFFNESSES)]
        settings = Rollout(speed=self.speed, sensing=EXACT_SENSING)
        folds = roll_out(
            knowing(self.policy, strips),
            Rod(),
            strips[0],
            [describe(strip) for strip in strips],
            settings=settings,
            rng=np.random.default_rng(0),
        )
        ends = [  # number of decisions up to the touch
            len(folds.trace) if touch is None else int(np.ceil(touch.time / settings.period))
            for touch in folds.touch
        ]
        return Adaptation(
            policy=self.policy,
            bending_lengths=tuple(strip.bending_length for strip in strips),
            paths=tuple(curve(folds.trace[:end, i]) for i, end in enumerate(ends)),
            displacements=finite_or_none(folds.displacement),
        )
