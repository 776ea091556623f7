"""The probability that a name is right: a logistic function of a few signs, calibrated.

The posterior speaks of the library's laws as they are. What no law accounts for, and how much of
the gap on held-out runs is closed, say whether to believe it; how much they say was measured on
verdicts held against the truth, a part of them with the true effect withheld from the library
(`cell study confidence`; Platt 1999, Probabilities for SV machines).
"""

from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import Field
from scipy import special

from cell.gap.verdict.schema import Gap, Probable
from drivers.settings import Settings, load

CONFIDENCE_FILE = Path(__file__).with_name("confidence.yaml")


@dataclass(frozen=True, slots=True)
class Signs:
    """What speaks for a name or against it.

    `ahead` [nats] is the lead of what is named, with its class, over the best other set; `left` the
    rms on held-out runs in units of noise and floor, `correlation` that of neighbours in time
    there; `unseen` the excess gap of the base there, `closed` the share of it that is gone.
    """

    ahead: float
    left: float
    correlation: float
    unseen: float
    closed: float

    @classmethod
    def of(cls, sets: Probable, gap: Gap) -> "Signs":
        """The signs that stand in a verdict; a lead over no other set is as good as any."""
        ahead = np.inf if sets.ahead is None else sets.ahead
        return cls(ahead, sets.left, sets.correlation, gap.before["excess"], gap.shrink)


class Weight(Settings):
    """What a sign adds to the log-odds: nothing at `low`, `weight` at `high`, and between them in
    proportion to its value or, `by_order`, to the logarithm of one more than its value.
    """

    weight: float
    low: float
    high: float
    by_order: bool = False

    def share(self, value: float) -> float:
        """Where `value` lies between `low` and `high`, 0 to 1."""
        ends = np.array([np.clip(value, self.low, self.high), self.low, self.high])
        at, low, high = np.log1p(ends) if self.by_order else ends
        return float((at - low) / (high - low))


class Calibration(Settings):
    """confidence.yaml: the log-odds of a right name are `intercept` plus what each sign weighs;
    `source` says of which verdicts that was found, `belongs_to` where the file lies.
    """

    intercept: float
    weights: dict[str, Weight]
    source: str = Field(min_length=1)
    belongs_to: str = ""

    def probability(self, found: Signs) -> float:
        """Probability that a name with these signs is right."""
        values = asdict(found)
        parts = [w.weight * w.share(values[name]) for name, w in self.weights.items()]
        return float(special.expit(self.intercept + sum(parts)))


@cache
def calibration() -> Calibration:
    """Calibration of the stated confidence that the package ships."""
    return load(CONFIDENCE_FILE, Calibration)


def confidence(sets: Probable, gap: Gap) -> float:
    """The probability that what is named is right."""
    return calibration().probability(Signs.of(sets, gap))
