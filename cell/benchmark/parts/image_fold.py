"""One fold through images, on the twin."""

from dataclasses import dataclass

from cell.benchmark.results import ImageFold
from cell.config.places import find_configs
from cell.operations.fold import Request, fold
from cell.operations.interrupt import Interrupt

COST = 10.0


@dataclass(frozen=True, slots=True)
class ThroughImages:
    """The fold of `request`; `of` is the digest of its input files."""

    request: Request
    of: str
    cost: float = COST

    @property
    def key(self) -> str:
        """Strip, policy and seed."""
        request = self.request
        return f"fold {request.strip} by {request.policy}, seed {request.choice.seed}"

    def measure(self) -> ImageFold:
        """Fold; raises KeyboardInterrupt when the operator stopped it."""
        with Interrupt() as interrupted:
            done = fold(self.request, interrupted=interrupted)
        if done.outcome == "interrupted":
            raise KeyboardInterrupt
        strip = find_configs(self.request.configs).strip(self.request.strip)
        return ImageFold(
            strip=done.strip,
            bending_length=strip.bending_length,
            retardation_time=strip.retardation_time,
            policy=done.policy,
            seed=done.seed,
            outcome=done.outcome,
            reason=done.reason,
            displacement=done.displacement,
            displacement_true=done.displacement_true,
            edge_offset_true=done.edge_offset_true,
            duration=done.duration,
            wall=done.wall,
            run=done.run,
        )
