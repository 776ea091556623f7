"""Calibrated probability that a named verdict is right: a logistic function of
evidence.

The posterior holds for the library's laws as they are. How well unseen runs are
predicted, and what no law accounts for, show whether to believe it; their weights were
measured on verdicts whose truth is known, a part of them with the true effect withheld
from the library (`python -m tests.lab study confidence`; Platt 1999, Probabilities for
SV machines).
"""

from functools import cache
from pathlib import Path

import numpy as np
from pydantic import Field
from scipy import special

from cell.gap.verdict.schema import VerdictEvidence
from drivers.base.settings import Settings, load

LEAST = 0.5  # probability from which an effect is named: it is rather right than wrong
FILES = {"strip": "confidence.yaml", "mechanism": "confidence-mechanism.yaml"}
"""Calibrations by the kind of subject on whose verdicts they were measured."""


class EvidenceWeight(Settings):
    """Contribution of one kind of evidence to the log-odds: zero at `low`, `weight` at
    `high`.

    Between them in proportion to its value or, `by_order`, to log(1 + value).
    """

    weight: float
    low: float
    high: float
    by_order: bool = False

    def share(self, value: float) -> float:
        """Position of `value` between the ends `low` and `high` of this kind of
        evidence, from 0 to 1.
        """
        ends = np.array([np.clip(value, self.low, self.high), self.low, self.high])
        clipped, low, high = np.log1p(ends) if self.by_order else ends
        return float((clipped - low) / (high - low))


class LogOddsCalibration(Settings):
    """Coefficients of the log-odds that a verdict is right: `intercept`, `weights` by
    evidence.

    `source` names the verdicts that were used, `belongs_to` the place of the file.
    """

    intercept: float
    weights: dict[str, EvidenceWeight]
    source: str = Field(min_length=1)
    belongs_to: str = ""

    def probability(self, evidence: VerdictEvidence) -> float:
        """Probability that a verdict with this `evidence` names the right effects."""
        parts = [
            w.weight * w.share(getattr(evidence, name))
            for name, w in self.weights.items()
        ]
        return float(special.expit(self.intercept + sum(parts)))


@cache
def calibration(kind: str = "strip") -> LogOddsCalibration:
    """Coefficients, shipped with this program, for the probability that a verdict on a
    subject of this `kind`, strip or mechanism, is right.
    """
    return load(Path(__file__).with_name(FILES[kind]), LogOddsCalibration)
