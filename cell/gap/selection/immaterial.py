"""Effects at amounts that do not matter, which every comparison of models expects to be there."""

from collections.abc import Mapping, Sequence

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import projection
from cell.gap.selection.beliefs import beliefs
from cell.gap.selection.screening import Probed
from drivers.types import Array

LEAST_NORM = 1e-6  # of a whitened response; a smaller one is rounding


def filling_floor(base: Estimate, probed: Sequence[Probed], *, believed: bool) -> dict[str, Array]:
    """Whitened responses (N, k) by name to the amount of each effect that fills the floor.

    One for each group of its probes that is seen once the base absorbs what it can. Where spreads
    of the base are `believed`, an effect that only they separate from the base is seen: changes of
    the base against its priors count like residuals.
    """
    about = projection(base, robustly=False)
    floors = [run.samples.floor for run in base.evidence.runs]
    allowed = np.concatenate([f / s for f, s in zip(floors, base.evidence.scales, strict=True)])
    size = float(np.linalg.norm(allowed))
    found: dict[str, Array] = {}
    for p in probed:
        firsts = np.concatenate([group[:, :1] for group in p.responses], axis=1)
        left = about.left(firsts)
        norms = np.sqrt(np.sum((firsts if believed else left) * left, axis=0))
        seen = norms > LEAST_NORM
        share = size / np.sqrt(max(int(seen.sum()), 1))
        found[p.candidate.name] = firsts[:, seen] * (share / norms[seen])
    return found


def immaterial(library: Mapping[str, Array]) -> list[Array]:
    """Whitened responses (N, k) to an immaterial amount of each effect.

    `library` has those to the amount that fills the floor.
    """
    return [beliefs().immaterial * response for response in library.values()]
