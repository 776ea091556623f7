"""Calibrated probability that a named verdict is right: a logistic function of evidence.

The posterior holds for the library's laws as they are. How well unseen runs are predicted, and what
no law accounts for, show whether to believe it; their weights were measured on verdicts whose truth
is known, a part of them with the true effect withheld from the library (`python -m tests.lab study
confidence`; Platt 1999, Probabilities for SV machines).
"""

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field
from scipy import special

from cell.gap.verdict.schema import Probable
from drivers.settings import Settings, load

LEAST = 0.5  # probability from which an effect is named: it is rather right than wrong
FILES = {"strip": "confidence.yaml", "mechanism": "confidence-mechanism.yaml"}
"""Calibrations by the kind of subject on whose verdicts they were measured."""


@dataclass(frozen=True, slots=True)
class VerdictEvidence:
    """Evidence for or against an accepted effect: log-odds and gains [nats], residuals, strain.

    `log_odds` [nats] are the posterior's of the effect, or of its class; `gain` [nats] is how
    much better unseen runs are predicted, `worst` that of the run or quantity that gains least.
    `left` is the rms that no law accounts for in the middle of the runs, in units of noise and
    floor, over channels that weigh alike; `correlation` that of neighbours in time in it, in fitted
    or held-out runs, where it is larger. `strain` is the largest deviation of the base from what
    the file states, in prior standard deviations.
    """

    log_odds: float
    gain: float
    worst: float
    left: float
    correlation: float
    strain: float

    @classmethod
    def of(cls, sets: Probable) -> Self:
        """Evidence in the posterior part `sets` of a verdict; log-odds of None are infinite."""
        log_odds = math.inf if sets.log_odds is None else sets.log_odds
        return cls(log_odds, sets.ahead, sets.worst, sets.left, sets.correlation, sets.strain)

    @property
    def correlated(self) -> float:
        """Rms [noise] of the autocorrelated part of the residuals that the model leaves.

        The correlation itself is high, too, where hardly anything is left.
        """
        return self.left * math.sqrt(max(self.correlation, 0.0))


class Weight(Settings):
    """Contribution of one kind of evidence to the log-odds: zero at `low`, `weight` at `high`.

    Between them in proportion to its value or, `by_order`, to log(1 + value).
    """

    weight: float
    low: float
    high: float
    by_order: bool = False

    def share(self, value: float) -> float:
        """Position of `value` between `low` and `high`, from 0 to 1."""
        ends = np.array([np.clip(value, self.low, self.high), self.low, self.high])
        clipped, low, high = np.log1p(ends) if self.by_order else ends
        return float((clipped - low) / (high - low))


class Calibration(Settings):
    """Coefficients of the log-odds that a verdict is right: `intercept`, `weights` by evidence.

    `source` names the verdicts that were used, `belongs_to` the place of the file.
    """

    intercept: float
    weights: dict[str, Weight]
    source: str = Field(min_length=1)
    belongs_to: str = ""

    def probability(self, evidence: VerdictEvidence) -> float:
        """Probability that a verdict with this `evidence` names the right effects."""
        parts = [w.weight * w.share(getattr(evidence, name)) for name, w in self.weights.items()]
        return float(special.expit(self.intercept + sum(parts)))


@cache
def calibration(kind: str = "strip") -> Calibration:
    """Load the shipped calibration of confidence for a kind of subject."""
    return load(Path(__file__).with_name(FILES[kind]), Calibration)
