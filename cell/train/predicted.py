"""Folds by `adaptive` with the prediction at the touch beside the result."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cell.campaign.statistic import Quantity, Statistic
from cell.folding.result import FoldResult
from cell.record.run import read_run
from cell.train.folds import facts
from policies.adaptive.critic import YIELD_UNIT

SIGMAS_95 = 1.96  # sigmas of 95 %

QUANTITIES = (
    Quantity("true", Statistic.MEAN_SIZE, label="mean |d|"),
    Quantity("true", Statistic.P95_SIZE, label="95 % |d|"),
    Quantity("true", Statistic.WORST_SIZE, label="worst |d|"),
    Quantity("edges", Statistic.MEAN_SIZE, label="mean |edges|"),
    Quantity("edges", Statistic.WORST_SIZE, label="worst |edges|"),
    Quantity("surprise", Statistic.MEAN, label="d - predicted"),
    Quantity("surprise", Statistic.SIGMA, label="its sigma"),
    Quantity("within_1", Statistic.SHARE, "%", 100.0, label="within 1 sigma", digits=0),
    Quantity("within_2", Statistic.SHARE, "%", 100.0, label="within 1.96", digits=0),
    Quantity("flagged", Statistic.SHARE, "%", 100.0, label="flagged", digits=0),
)


def compare(result: FoldResult) -> Mapping[str, Any]:
    """Facts of a fold, the prediction [m], and the estimate of the strip behind it."""
    stored = read_run(Path(result.run)).result
    predicted = None if stored is None else stored.foretold
    agreed = None if stored is None else stored.agreement
    known = dict(facts(result)) | {
        "residual": None if agreed is None else agreed.residual,
        "flagged": agreed is not None and not agreed.like_model,
    }
    true = result.displacement_true
    if predicted is None or true is None:
        return known
    surprise = true - predicted.displacement
    ratio = abs(surprise) / predicted.sigma
    return known | {
        "predicted": predicted.displacement,
        "sigma": predicted.sigma,
        "surprise": surprise,
        "within_1": ratio < 1.0,
        "within_2": ratio < SIGMAS_95,
        "believed_length": math.log(predicted.bending_length.value),
        "believed_time": math.log(predicted.retardation_time.value),
        "believed_friction": math.log1p(predicted.yield_curvature.value / YIELD_UNIT),
    }
