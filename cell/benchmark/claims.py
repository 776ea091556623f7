"""The paper's claims, tested in folds through images."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cell.benchmark import paper
from cell.benchmark.results import ImageFold, Results
from cell.benchmark.summary import spread
from cell.report.words import millimetres
from drivers.types import Array

SPREAD_ROUNDING = 5e-5  # m, by which a spread may exceed a limit stated in whole millimetres
THREE = ("triangular", "circular", "feedback")
SIDES = {"triangular": ("negative", -1.0), "circular": ("positive", 1.0)}


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of the paper (`says`), the result `here`, and whether the claim is `held`."""

    says: str
    here: str
    held: bool


def claims(results: Results) -> tuple[Claim, ...]:
    """Test the paper's claims that these folds can decide; the main claim comes first."""
    folds = {policy: results.folds(policy) for policy in results.asked.policies}
    return tuple(_claims({policy: each for policy, each in folds.items() if each}, results))


def _claims(folds: dict[str, tuple[ImageFold, ...]], results: Results) -> Iterator[Claim]:
    count = len(results.asked.strips)
    if "feedback" in folds:
        yield _limit_claim(folds["feedback"], count, "feedback", paper.WORST["feedback"])
    for policy, (word, sign) in SIDES.items():
        if policy in folds:
            yield _sign_claim(folds[policy], count, policy, word, sign)
    if folds.keys() >= set(THREE):
        yield _smallest_mean_claim(folds)
    if "planned" in folds:
        who, limit = "methods that know the properties", paper.KNOWN_STRIP_BOUND
        yield _limit_claim(folds["planned"], count, who, limit)
    again = {p: results.repeats(p) for p in THREE if p in folds}
    if any(len(f) > 1 for f in again.values()):
        yield _repeatability_claim(again)


def _limit_claim(folds: tuple[ImageFold, ...], count: int, who: str, limit: float) -> Claim:
    d = np.abs(_displacements(folds))
    held = len(folds) == count and bool(np.all(d < limit))
    says = f"{who}: under {1e3 * limit:.0f} mm on every strip"
    return Claim(says, _worst_text(folds, count), held)


def _worst_text(folds: tuple[ImageFold, ...], count: int) -> str:
    d = np.abs(_displacements(folds))
    touched = np.isfinite(d)
    if not touched.any():
        return f"no touch on {count} strips"
    worst = int(np.nanargmax(d))
    text = f"worst {millimetres(float(d[worst]))}, on {folds[worst].strip}"
    missing = count - int(touched.sum())
    return text + (f"; {missing} of {count} strips without a touch" if missing else "")


def _sign_claim(
    folds: tuple[ImageFold, ...], count: int, policy: str, word: str, sign: float
) -> Claim:
    d = _displacements(folds)
    agreeing = int(np.sum(sign * d > 0))
    mean = millimetres(float(np.nanmean(d)) if np.isfinite(d).any() else None, signed=True)
    stated = millimetres(paper.MEANS[policy], signed=True)
    return Claim(
        f"{policy}: {word} on every strip, {stated} in the mean",
        f"{word} on {agreeing} of {count}, {mean} in the mean",
        agreeing == count,
    )


def _smallest_mean_claim(folds: dict[str, tuple[ImageFold, ...]]) -> Claim:
    means = {
        p: float(np.mean(np.nan_to_num(np.abs(_displacements(folds[p])), nan=np.inf)))
        for p in THREE
    }
    values = ", ".join(f"{p} {millimetres(mean)}" for p, mean in means.items())
    least = min(means.values())
    held = means["feedback"] == least and np.isfinite(least)
    return Claim("feedback outperforms triangular and circular", f"mean |d| {values}", bool(held))


def _repeatability_claim(again: dict[str, tuple[ImageFold, ...]]) -> Claim:
    spreads = {policy: spread(folds) for policy, folds in again.items()}
    values = ", ".join(f"{policy} {millimetres(value)}" for policy, value in spreads.items())
    limit = paper.REPEATABILITY
    return Claim(
        f"five folds of one strip differ by at most {1e3 * limit:.0f} mm by each method",
        f"{max(len(f) for f in again.values())} folds: {values}",
        bool(np.all(np.array(list(spreads.values())) <= limit + SPREAD_ROUNDING)),
    )


def _displacements(folds: tuple[ImageFold, ...]) -> Array:
    return np.array([f.displacement for f in folds], dtype=np.float64)
