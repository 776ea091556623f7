"""Calibrated probability that a named verdict is right: a logistic function of its features.

The posterior holds for the library's laws as they are. What no law accounts for, and how much of
the gap on held-out runs is closed, show whether to believe it; their weights were measured on
verdicts whose truth is known, a part of them with the true effect withheld from the library
(`python -m tests.lab study confidence`; Platt 1999, Probabilities for SV machines).
"""

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import Field
from scipy import special

from cell.gap.verdict.schema import Gap, Probable
from drivers.settings import Settings, load

LEFT_OPEN = 0.01  # share of verdicts with the true cause that leave too much; customary
CONFIDENCE_FILE = Path(__file__).with_name("confidence.yaml")


@dataclass(frozen=True, slots=True)
class Features:
    """Features of a verdict that speak for or against the named effects.

    `log_odds` [nats] are the posterior's of what is named, or its class; `left` the rms on held-out
    runs in units of noise and floor, `correlation` that of neighbours in time there; `unseen` the
    excess gap of the base there, `closed` the share of it that is gone; `law` is 1 where a law is
    offered beside.
    """

    log_odds: float
    left: float
    correlation: float
    unseen: float
    closed: float
    law: float = 0.0

    @classmethod
    def of(cls, sets: Probable, gap: Gap) -> "Features":
        """Features from the posterior and gap of a verdict; without log-odds they are infinite."""
        log_odds = np.inf if sets.log_odds is None else sets.log_odds
        unseen, law = gap.before["excess"], float(sets.law)
        return cls(log_odds, sets.left, sets.correlation, unseen, gap.shrink, law)

    @property
    def correlated(self) -> float:
        """Rms of the correlated part of `left`, in its units: root of the lag-one autocovariance.

        The correlation itself is high, too, where hardly anything is left: through images noise is
        small, and perception's errors, far below the floor, are all there is.
        """
        return self.left * math.sqrt(max(self.correlation, 0.0))


class Weight(Settings):
    """Contribution of one feature to the log-odds: zero at `low`, `weight` at `high`.

    Between them in proportion to its value or, `by_order`, to log(1 + value).
    """

    weight: float
    low: float
    high: float
    by_order: bool = False

    def share(self, value: float) -> float:
        """Position of `value` between `low` and `high`, 0 to 1."""
        ends = np.array([np.clip(value, self.low, self.high), self.low, self.high])
        at, low, high = np.log1p(ends) if self.by_order else ends
        return float((at - low) / (high - low))


class Calibration(Settings):
    """Content of confidence.yaml: `intercept` and `weights` of the log-odds of a right verdict.

    `most_left` is the rms on held-out runs, in units of noise and floor, that all but LEFT_OPEN of
    right verdicts stay below. `source` names the verdicts that were used, `belongs_to` the place of
    the file.
    """

    most_left: float = Field(gt=0)
    intercept: float
    weights: dict[str, Weight]
    source: str = Field(min_length=1)
    belongs_to: str = ""

    def probability(self, found: Features) -> float:
        """Probability that a verdict with the features `found` names the right effects."""
        parts = [w.weight * w.share(getattr(found, name)) for name, w in self.weights.items()]
        return float(special.expit(self.intercept + sum(parts)))


@cache
def calibration() -> Calibration:
    """Load the calibration of stated confidence that the package ships."""
    return load(CONFIDENCE_FILE, Calibration)


def confidence(sets: Probable, gap: Gap) -> float:
    """Probability that the named effects of a verdict are right."""
    return calibration().probability(Features.of(sets, gap))
