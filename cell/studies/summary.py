"""Summary of a benchmark: statistics of each policy, and the published claims beside
them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from cell.report.words import NO_VALUE, millimetres, plural
from cell.studies.results import (
    EffectFolds,
    ImageFold,
    MissingPart,
    RangeFolds,
    Results,
    displacements,
)
from drivers.base.errors import in_mm
from policies.rollout import Misses

Table = tuple[Sequence[str], Sequence[Sequence[str]], str]
PAPER_MEANS = {"triangular": -0.0368, "circular": 0.0627}  # m, over ten materials
PAPER_WORST = {"feedback": 0.020}  # m, on every material
# m, methods that know the strip stay under it on the same materials
KNOWN_STRIP_BOUND = 0.010
REPEATABILITY = 0.001  # m, largest difference among five folds of one strip
# m, by which a spread may exceed a limit stated in whole millimetres
SPREAD_ROUNDING = 5e-5
PAPER_POLICIES = ("triangular", "circular", "feedback")
NAN = float("nan")


def numeral(value: float, *, signed: bool = False) -> str:
    """Format a length [m] as millimetres without a unit."""
    return millimetres(value, signed).removesuffix(" mm")


@dataclass(frozen=True, slots=True)
class StripNumbers:
    """Statistics of folds through images: measured d, true |offset| of laid edges [m],
    or NaN.
    """

    folded: int
    of: int
    mean: float
    low: float
    high: float
    worst: float
    worst_strip: str
    misread: float
    offset: float = NAN
    worst_offset: float = NAN

    @classmethod
    def of_folds(cls, folds: tuple[ImageFold, ...], asked: int) -> "StripNumbers":
        """Statistics of `folds`, out of `asked` strips."""
        touched = [fold for fold in folds if fold.displacement is not None]
        if not touched:
            return cls(
                folded=0,
                of=asked,
                mean=NAN,
                low=NAN,
                high=NAN,
                worst=NAN,
                worst_strip="",
                misread=NAN,
            )
        d = displacements(touched)
        true = np.array([fold.displacement_true for fold in touched], dtype=np.float64)
        worst = int(np.argmax(np.abs(d)))
        apart = [
            abs(f.edge_offset_true) for f in touched if f.edge_offset_true is not None
        ]
        return cls(
            folded=len(touched),
            of=asked,
            mean=float(d.mean()),
            low=float(d.min()),
            high=float(d.max()),
            worst=float(abs(d[worst])),
            worst_strip=touched[worst].strip,
            misread=max(np.abs(d - true)[np.isfinite(true)].tolist(), default=NAN),
            offset=float(np.mean(apart)) if apart else NAN,
            worst_offset=max(apart, default=NAN),
        )


@dataclass(frozen=True, slots=True)
class RangeNumbers(Misses):
    """Statistics of |d| [m] over the grid of strips, with the mean pull on the fixed
    edge [N].
    """

    force: float

    @classmethod
    def of_folds(cls, folds: RangeFolds | None) -> "RangeNumbers":
        """Statistics of `folds` over the grid of strips; NaN where there are none."""
        if folds is None:
            return cls(mean=NAN, quantile_95=NAN, worst=NAN, untouched=0, force=NAN)
        return cls(
            **asdict(Misses.from_displacements(folds.displacement_grid)),
            force=float(np.mean(folds.force)),
        )


@dataclass(frozen=True, slots=True)
class Row:
    """Statistics of one policy [m]: over strips, the range in both engines, and
    repeats.
    """

    policy: str
    strips: StripNumbers
    rod: RangeNumbers
    chain: RangeNumbers
    repeats: int
    spread: float

    def strip_cells(self) -> tuple[str, ...]:
        """Cells of a row in the table of strips: policy, count, then statistics of d
        [mm].
        """
        s = self.strips
        return (
            self.policy,
            f"{s.folded} of {s.of}",
            *(numeral(length, signed=True) for length in (s.mean, s.low, s.high)),
            numeral(s.worst),
            s.worst_strip,
            numeral(s.misread),
            numeral(self.spread),
        )

    def range_cells(self) -> tuple[str, ...]:
        """Cells of the table of ranges: |d| [mm] in the rod and on the chain, the pull
        [N].
        """
        rod = self.rod
        return (
            self.policy,
            *(numeral(length) for length in (rod.mean, rod.quantile_95, rod.worst)),
            str(rod.untouched),
            *(numeral(length) for length in (self.chain.mean, self.chain.worst)),
            NO_VALUE if np.isnan(rod.force) else f"{rod.force:.2f}",
        )


def rows(results: Results) -> tuple[Row, ...]:
    """Rows of the summary, one for each policy in the requested order."""
    return tuple(
        Row(
            policy=policy,
            strips=StripNumbers.of_folds(
                results.folds(policy), len(results.asked.strips)
            ),
            rod=RangeNumbers.of_folds(results.over_range(policy, "rod")),
            chain=RangeNumbers.of_folds(results.over_range(policy, "chain")),
            repeats=len(results.repeats(policy)),
            spread=spread(results.repeats(policy)),
        )
        for policy in results.asked.policies
    )


def spread(folds: tuple[ImageFold, ...]) -> float:
    """Largest difference [m] among the displacements of `folds`; NaN of fewer than
    two.
    """
    d = displacements(folds)
    d = d[np.isfinite(d)]
    return float(np.ptp(d)) if d.size > 1 else NAN


def misses_text(folds: EffectFolds) -> str:
    """|d| of `folds` as text [mm]: mean, 95 % and worst, and the number without a
    touch.
    """
    found = Misses.from_displacements(np.array(folds.displacement, dtype=np.float64))
    if np.isnan(found.mean):
        return NO_VALUE
    text = " / ".join(map(numeral, (found.mean, found.quantile_95, found.worst)))
    return f"{text}, {found.untouched} without a touch" if found.untouched else text


@dataclass(frozen=True, slots=True)
class Claim:
    """Published claim (`says`), the result `here`, and whether the claim is `held`."""

    says: str
    here: str
    held: bool


def claims(results: Results) -> Iterator[Claim]:
    """Yield the published claims that `results` can decide, tested, the main claim
    first.
    """
    folds = {p: found for p in results.asked.policies if (found := results.folds(p))}
    count = len(results.asked.strips)
    if "feedback" in folds:
        yield _limit_claim(
            folds["feedback"], count, "feedback", PAPER_WORST["feedback"]
        )

    for policy in filter(folds.__contains__, PAPER_MEANS):
        yield _sign_claim(folds[policy], count, policy)

    if folds.keys() >= set(PAPER_POLICIES):
        yield _smallest_mean_claim(folds)
    if "planned" in folds:
        who = "methods that know the properties"
        yield _limit_claim(folds["planned"], count, who, KNOWN_STRIP_BOUND)

    repeats = {p: results.repeats(p) for p in PAPER_POLICIES if p in folds}
    if any(len(f) > 1 for f in repeats.values()):
        yield _repeatability_claim(repeats)


def _limit_claim(
    folds: tuple[ImageFold, ...], count: int, who: str, limit: float
) -> Claim:
    """Claim that |d| stays under `limit` [m] on each of `count` strips."""
    d = np.abs(displacements(folds))
    untouched = count - int(np.isfinite(d).sum())
    if untouched == count:
        here = f"no touch on {count} strips"
    else:
        worst = int(np.nanargmax(d))
        here = f"worst {millimetres(d[worst])}, on {folds[worst].strip}"
        here += f"; {untouched} of {count} strips without a touch" if untouched else ""
    says = f"{who}: under {in_mm(limit)} on every strip"
    return Claim(says, here, len(folds) == count and bool(np.all(d < limit)))


def _sign_claim(folds: tuple[ImageFold, ...], count: int, policy: str) -> Claim:
    """Claim that d has the sign of its published mean for `policy` on each of `count`
    strips.
    """
    d = displacements(folds)
    stated = PAPER_MEANS[policy]
    word = "positive" if stated > 0 else "negative"
    agreeing = int(np.sum(stated * d > 0))
    mean = float(np.nanmean(d)) if np.isfinite(d).any() else None
    return Claim(
        f"{policy}: {word} on every strip, {millimetres(stated, signed=True)} in the"
        " mean",
        f"{word} on {agreeing} of {count}, {millimetres(mean, signed=True)} in the"
        " mean",
        agreeing == count,
    )


def _smallest_mean_claim(folds: dict[str, tuple[ImageFold, ...]]) -> Claim:
    """Claim that `feedback` has the smallest mean |d| of the published policies."""
    sizes = {p: np.abs(displacements(folds[p])) for p in PAPER_POLICIES}
    means = {
        p: float(np.nan_to_num(size, nan=np.inf).mean()) for p, size in sizes.items()
    }
    values = ", ".join(f"{p} {millimetres(mean)}" for p, mean in means.items())
    least = min(means.values())
    held = means["feedback"] == least and np.isfinite(least)
    return Claim(
        "feedback outperforms triangular and circular", f"mean |d| {values}", bool(held)
    )


def _repeatability_claim(repeats: dict[str, tuple[ImageFold, ...]]) -> Claim:
    """Claim that repeated folds of one strip differ by at most REPEATABILITY."""
    spreads = {policy: spread(folds) for policy, folds in repeats.items()}
    values = ", ".join(
        f"{policy} {millimetres(value)}" for policy, value in spreads.items()
    )
    limit = REPEATABILITY
    return Claim(
        f"five folds of one strip differ by at most {in_mm(limit)} by each method",
        f"{max(len(f) for f in repeats.values())} folds: {values}",
        all(value <= limit + SPREAD_ROUNDING for value in spreads.values()),
    )


def claim_lines(results: Results) -> Iterator[str]:
    """Yield lines of text on the published claims, and on parts that are missing."""
    for claim in claims(results):
        yield (
            f"{'held' if claim.held else 'not held':9}{claim.says}\n          "
            f" {claim.here}"
        )
    for result in results.results:
        if isinstance(result, MissingPart):
            yield f"missing  {result.part}: {result.reason}"


def tables(results: Results) -> Iterator[Table]:
    """Tables of folds through images and over the grid of strips, as (columns, rows,
    title).
    """
    summary = rows(results)
    strips = plural(len(results.asked.strips), "strip")
    yield (
        ("policy", "folds", "mean", "from", "to", "worst", "on", "error", "differ"),
        [row.strip_cells() for row in summary],
        (
            f"{strips}, folded through images: displacement in mm "
            "(error: seen − true, at most; differ: folds of one strip, most among them)"
        ),
    )
    size = results.asked.extent
    yield (
        (
            "policy",
            "mean",
            "95 %",
            "worst",
            "no touch",
            "chain",
            "its worst",
            "force N",
        ),
        [row.range_cells() for row in summary],
        (
            f"The paper's range, state-based: |d| in mm, {size.grid} x {size.grid} in"
            f" the rod, {size.chain} x {size.chain} on the chain"
        ),
    )
