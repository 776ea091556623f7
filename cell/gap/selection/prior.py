"""Prior of effects: how many are expected, how wrong laws are, and the spike prior of absent ones.

An absent effect is expected at an amount that does not matter, by the floor of the samples.
`python -m tests.lab study beliefs` fits these numbers.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import Field

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import projection
from cell.gap.selection.screening import ProbeResponses
from drivers.settings import Seconds, Settings, load
from drivers.types import Array

BELIEFS_FILE = Path(__file__).with_name("beliefs.yaml")
LEAST_NORM = 1e-6  # of a whitened response; a smaller one is rounding


class Beliefs(Settings):
    """Content of beliefs.yaml: the prior of the effects before runs are seen.

    Of the library `expected` effects are present. The spike prior of an absent one has a response
    of this share (one sigma, `immaterial`) of what the floor allows. The relative model error of a
    law is half-normal of sigma `wrong`, summed over `shares`, with a correlation time `memory` [s].
    `source` says where the numbers come from, `belongs_to` the place of the file.
    """

    expected: float = Field(gt=0.0)
    immaterial: float = Field(ge=0.0)
    wrong: float = Field(gt=0.0)
    shares: tuple[float, ...] = Field(min_length=1)
    memory: Seconds = Field(gt=0.0)
    source: str = Field(min_length=1)
    belongs_to: str = ""


@cache
def beliefs() -> Beliefs:
    """Load the prior that the package ships."""
    return load(BELIEFS_FILE, Beliefs)


def filling_floor(
    base: Estimate, probed: Sequence[ProbeResponses], *, believed: bool
) -> dict[str, Array]:
    """Whitened responses (N, k) by name to the amount of each effect that fills the floor.

    A column for each group of its probes that the refitted base cannot absorb, scaled (least
    squares over the runs) to the energy of the floor, so that an effect of one run alone may fill
    the floor of that run alone. Where spreads of the base are `believed`, its changes against its
    priors count like residuals: an effect that only they separate from the base has a column.
    """
    about = projection(base, robustly=False)
    evidence = base.evidence
    runs = [r.samples.floor / s for r, s in zip(evidence.runs, evidence.scales, strict=True)]
    floor = np.array([allowed @ allowed for allowed in runs])
    starts = np.cumsum([0, *map(len, runs[:-1])])
    found: dict[str, Array] = {}
    for p in probed:
        firsts = np.concatenate([group[:, :1] for group in p.responses], axis=1)
        left = about.left(firsts)
        norms = np.sqrt(np.sum((firsts if believed else left) * left, axis=0))
        seen = norms > LEAST_NORM
        by_run = np.add.reduceat(left[:, seen] ** 2, starts, axis=0)
        by_run /= by_run.sum(axis=0)
        size = np.sqrt(floor @ by_run / np.sum(by_run**2, axis=0))
        share = size / np.sqrt(max(int(seen.sum()), 1))
        found[p.candidate.name] = firsts[:, seen] * (share / norms[seen])
    return found


def immaterial(library: Mapping[str, Array]) -> list[Array]:
    """Whitened responses (N, k) to one sigma of each effect's spike prior.

    `library` has those to the amount that fills the floor.
    """
    return [beliefs().immaterial * response for response in library.values()]
