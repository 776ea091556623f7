"""One fold through images, on the twin."""

from dataclasses import dataclass

from cell.config.places import find_configs
from cell.folding.fold import Request, fold
from cell.studies.benchmark.results import ImageFold

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
        """Fold, without a page: `cell report` draws it from the run."""
        done = fold(self.request, page=False)
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
