"""Bending length of a strip from photographs, pooled, with warnings about error
sources; as JSON and text.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, norm, t

from cell.setup.strips.cantilever_fit import (
    STRAIGHT,
    Fit,
    RestCurvature,
    RestCurvaturePrior,
    fit_photograph,
)
from cell.setup.strips.photograph import Photograph
from drivers.base.errors import ConfigurationError, in_mm, in_percent
from drivers.base.types import Array

CONFIDENCE = 0.95
# 1/m, rest curvatures that are tried
REST_CURVATURES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
DECISIVE = 5.0  # of log evidence, for a prior with one more unknown

Fits = tuple[Fit, ...]


@dataclass(frozen=True, slots=True)
class Pooled:
    """Mean `value` of several measurements, with its 95 % interval from `low` to
    `high`, and by how much the measurements scatter.

    `scatter` is the standard deviation beyond their own; `agreement` the probability of
    at least this scatter if the measurements' own sigmas were all.
    """

    value: float
    low: float
    high: float
    scatter: float
    agreement: float


def pool(values: Sequence[float], sigmas: Sequence[float]) -> Pooled:
    """Mean of `values` with the standard deviations `sigmas`, where the values may
    scatter by more than these say.

    Scatter by Paule and Mandel, interval by Hartung and Knapp, never narrower than the
    sigmas alone make it.
    """
    y = np.array(values)
    variance = np.array(sigmas) ** 2
    scatter = _scatter(y, variance)
    weight = 1 / (variance + scatter)
    value = float((weight * y).sum() / weight.sum())
    quantile = 0.5 + CONFIDENCE / 2
    half = float(norm.ppf(quantile) / np.sqrt(weight.sum()))

    agreement = 1.0
    freedom = len(y) - 1
    if freedom:
        agreement = float(
            chi2.sf(_excess_squares(y, variance, scatter=0.0) + freedom, freedom)
        )
        knapp_variance = (weight * (y - value) ** 2).sum() / (freedom * weight.sum())
        half = max(half, float(t.ppf(quantile, freedom) * np.sqrt(knapp_variance)))
    ends = value - half, value + half
    return Pooled(value, *ends, scatter=float(np.sqrt(scatter)), agreement=agreement)


def _excess_squares(y: Array, variance: Array, scatter: float) -> float:
    """Weighted sum of squares of the values `y` about their mean, minus the value that
    is expected of it, which is their number minus one.

    Weights are the inverse of `variance` (n,) plus the variance `scatter` between
    measurements.
    """
    weight = 1 / (variance + scatter)
    mean = (weight * y).sum() / weight.sum()
    return float((weight * (y - mean) ** 2).sum() - (len(y) - 1))


def _scatter(y: Array, variance: Array) -> float:
    """Variance of the values `y` beyond their own `variance` that explains how much
    they differ; zero where their own is enough.
    """
    if len(y) < 2 or _excess_squares(y, variance, scatter=0.0) <= 0:
        return 0.0
    largest = float(np.ptp(y) ** 2) * len(y)  # at which the sum is less than expected
    return float(
        brentq(lambda scatter: _excess_squares(y, variance, scatter), 0.0, largest)
    )


@dataclass(frozen=True, slots=True)
class Bending:
    """Bending length [m] of a strip from all photographs, with the fit of each
    photograph.

    `fits` are with the best rest-curvature prior, `straight` with a straight strip;
    bending lengths [m] pooled over all photographs and for each overhang.
    """

    fits: Fits
    straight: Fits
    bending_length: Pooled
    by_overhang: tuple[tuple[float, Pooled], ...]

    @property
    def prior(self) -> RestCurvaturePrior:
        """What was assumed of the strip's curvature without load, the same for all
        photographs.
        """
        return self.fits[0].prior

    @property
    def curl(self) -> Pooled:
        """Mean over the photographs of the strip's uniform curvature without load
        [1/m], with its interval.
        """
        if self.prior.kind is RestCurvature.STRAIGHT:
            return Pooled(value=0.0, low=0.0, high=0.0, scatter=0.0, agreement=1.0)
        values, sigmas = zip(*(fitted.curl for fitted in self.fits), strict=True)
        return pool(values, sigmas)


def _measure_bending(photographs: Sequence[Photograph]) -> Bending:
    """Fit the bending length to all photographs, with one assumption for all on the
    strip's curvature without load: the one that explains them best.
    """
    straight = tuple(fit_photograph(photograph, STRAIGHT) for photograph in photographs)
    fits = straight
    for kind in (RestCurvature.CURLED, RestCurvature.SET):
        curved = _best_fits(photographs, straight, kind)
        if evidence(curved) > evidence(fits) + DECISIVE:
            fits = curved

    overhang_of = attrgetter("photograph.overhang")
    groups = groupby(sorted(fits, key=overhang_of), key=overhang_of)
    return Bending(
        fits=fits,
        straight=straight,
        bending_length=_pool_lengths(fits),
        by_overhang=tuple(
            (overhang, _pool_lengths(list(group))) for overhang, group in groups
        ),
    )


def evidence(fits: Sequence[Fit]) -> float:
    """Logarithm of the probability of all photographed midlines under what their `fits`
    assume of the curvature without load.
    """
    return sum(fitted.evidence for fitted in fits)


def _pool_lengths(fits: Sequence[Fit]) -> Pooled:
    """Mean bending length [m] of the `fits`, averaged by logarithms, with
    its interval.
    """
    logs = pool(
        [float(np.log(f.bending_length)) for f in fits], [f.sigma for f in fits]
    )
    value, low, high = np.exp([logs.value, logs.low, logs.high]).tolist()
    return replace(logs, value=value, low=low, high=high)


def _best_fits(
    photographs: Sequence[Photograph], start: Fits, kind: RestCurvature
) -> Fits:
    """Fits of the photographs that assume a curvature without load of this `kind`, at
    the standard deviation that explains them best.
    """
    candidates: list[Fits] = []
    for spread in REST_CURVATURES:
        start = _fit_all(photographs, RestCurvaturePrior(kind, spread), start)
        candidates.append(start)

    scores = np.array([evidence(fits) for fits in candidates])
    j = int(np.argmax(scores))
    if j in (0, len(REST_CURVATURES) - 1):
        return candidates[j]

    # top of the parabola through three scores; the spreads that were tried double each
    # time
    second_difference = scores[j - 1] - 2 * scores[j] + scores[j + 1]
    shift = float(0.5 * (scores[j - 1] - scores[j + 1]) / second_difference)
    prior = RestCurvaturePrior(kind, REST_CURVATURES[j] * 2**shift)
    refined = _fit_all(photographs, prior, candidates[j])
    return max(refined, candidates[j], key=evidence)


def _fit_all(
    photographs: Sequence[Photograph], prior: RestCurvaturePrior, starts: Fits
) -> Fits:
    """Fits of the photographs under one `prior`, each of which begins from the fit in
    `starts` at the same index.
    """
    pairs = zip(photographs, starts, strict=True)
    return tuple(
        fit_photograph(photograph, prior, start) for photograph, start in pairs
    )


VISIBLE = 0.1  # widths by which a straight-born strip misses the midline
DISAGREEMENT_LEVEL = 0.05  # probability below which photographs disagree
LARGEST_UNCERTAINTY = 0.10  # half width of the interval over the value
# widths, or m; a sharper bend is hardly visible
SHARP_WIDTHS, SHARP_RADIUS = 1.0, 0.002
SMALLEST_WIDTH_RATIO = 1.5  # ratio of the strip's widths in two photographs
OVERHANGS = (2, 5)  # bending lengths: range in which a photograph is most accurate
KEPT_DIGITS = 4  # digits
# of the overhang, rms of the midline; with more it is no hanging strip
LARGEST_MISFIT = 0.02
LEDGE_TOLERANCE = 0.25  # of the overhang, from the picture's border to the ledge
LARGEST_SIGMA = 0.5  # of ln(bending length)
# m, bending lengths of strips
SHORTEST_BENDING_LENGTH, LONGEST_BENDING_LENGTH = 0.002, 0.2


@dataclass(frozen=True, slots=True)
class Measurement:
    """Measured bending length of the strip called `strip`, with texts that warn of
    sources of error.
    """

    strip: str
    bending: Bending
    warnings: tuple[str, ...]

    @property
    def bending_length(self) -> Pooled:
        """Bending length [m] of the strip, with its 95 % interval."""
        return self.bending.bending_length

    @property
    def value(self) -> float:
        """Bending length [m] of the strip, rounded to the digits that a strip file
        keeps.
        """
        return float(f"{self.bending_length.value:.{KEPT_DIGITS}g}")

    def line(self) -> dict[str, Any]:
        """Content of a JSON object on the measurement, with lengths in metres."""
        bending = self.bending
        return {
            "strip": self.strip,
            "bending_length": _interval(self.bending_length),
            "born": bending.prior.kind.value,
            "rest_curvature": {
                "mean": _interval(bending.curl),
                "spread": bending.prior.spread,
            },
            "scatter": self.bending_length.scatter,
            "agreement": self.bending_length.agreement,
            "by_overhang": [
                {"overhang": overhang, **_interval(pooled)}
                for overhang, pooled in bending.by_overhang
            ],
            "photographs": [
                {
                    "photo": str(fit.photograph.path),
                    "overhang": fit.photograph.overhang,
                    "bending_length": fit.bending_length,
                    "sigma": fit.sigma * fit.bending_length,
                    "miss": fit.rms,
                    "straight": {
                        "bending_length": straight.bending_length,
                        "miss": straight.rms,
                    },
                }
                for fit, straight in zip(bending.fits, bending.straight, strict=True)
            ],
            "warnings": list(self.warnings),
        }

    def text(self) -> str:
        """Text for the operator on the measured bending length, in millimetres, and on
        what makes it doubtful.
        """
        count = len(self.bending.fits)
        lines = [
            f"{self.strip}: bending length {_mm_text(self.bending_length)}"
            f" from {count} photograph{'s' * (count > 1)}"
        ]
        for overhang, pooled in self.bending.by_overhang:
            lines.append(f"  overhang {1e3 * overhang:.4g} mm: {_mm_text(pooled)}")
        if count > 1 and self.bending_length.agreement > DISAGREEMENT_LEVEL:
            lines.append("  the photographs agree within their own errors")
        return "\n".join(lines + [f"warning: {warning}" for warning in self.warnings])


def measure(strip: str, photographs: Sequence[Photograph]) -> Measurement:
    """Measure the bending length of the strip called `strip` from photographs of it in
    which it hangs over a ledge.
    """
    bending = _measure_bending(photographs)
    for fit in bending.fits:
        _require_hanging_strip(fit)
        _require_plausible_length(fit)
    warnings = (
        _curvature_warning(bending),
        _scatter_warning(bending),
        _overhang_warning(bending),
        _width_warning(bending),
        _uncertainty_warning(bending),
    )
    return Measurement(strip, bending, tuple(filter(None, warnings)))


def _require_hanging_strip(fitted: Fit) -> None:
    """Raise ConfigurationError where the fit to a photograph shows that it has no strip
    that hangs over a ledge.
    """
    overhang = fitted.photograph.overhang
    misfit = fitted.rms > LARGEST_MISFIT * overhang
    ledge_elsewhere = abs(fitted.ledge) > LEDGE_TOLERANCE * overhang
    if misfit or ledge_elsewhere or fitted.sigma > LARGEST_SIGMA:
        raise ConfigurationError(
            f"{fitted.photograph.path}: picture: this does not hang like a strip; crop"
            " it at the ledge, upright, with the strip leaving the ledge at the left"
            " border"
        )


def _require_plausible_length(fitted: Fit) -> None:
    """Raise ConfigurationError where the fitted bending length is one that no fabric
    has.
    """
    if not SHORTEST_BENDING_LENGTH <= fitted.bending_length <= LONGEST_BENDING_LENGTH:
        raise ConfigurationError(
            f"{fitted.photograph.path}: a bending length of"
            f" {1e3 * fitted.bending_length:.3g} mm is out of range, allowed:"
            f" {1e3 * SHORTEST_BENDING_LENGTH:g} to {1e3 * LONGEST_BENDING_LENGTH:g}"
            " mm; let the strip hang over by 2 to 5 bending lengths, and give that"
            " --overhang"
        )


def _curvature_warning(bending: Bending) -> str:
    """Text that warns of a strip that is curved without load; empty where no such
    curvature is visible.
    """
    misfit = max(fit.rms / fit.photograph.width for fit in bending.straight)
    if bending.prior.kind is RestCurvature.STRAIGHT or misfit < VISIBLE:
        return ""

    lengths = 1e3 * np.array([fit.bending_length for fit in bending.straight])
    seeming = f"{lengths.min():.1f}"
    if len(lengths) > 1:
        seeming += f" to {lengths.max():.1f}"

    furthest = 1e3 * max(np.abs(fit.misses).max() for fit in bending.straight)
    curl = bending.curl
    spread = bending.prior.spread
    shape = f"it has a set of its own, of about {spread:.0f} 1/m, along it"
    if bending.prior.kind is RestCurvature.CURLED:
        shape = (
            f"unloaded it curls by {curl.value:+.1f} 1/m ({curl.low:+.1f} to"
            f" {curl.high:+.1f})"
        )

    return (
        f"pre_curl: this is not the shape of a strip that was born straight: {shape}."
        " The bending length allows for it; a straight-born strip would miss the"
        f" photographs by up to {furthest:.1f} mm and seem to have {seeming} mm"
    )


def _scatter_warning(bending: Bending) -> str:
    """Text that warns of photographs that give different bending lengths; empty where
    they agree.
    """
    pooled = bending.bending_length
    if pooled.agreement > DISAGREEMENT_LEVEL:
        return ""
    return (
        f"the photographs disagree by {in_percent(pooled.scatter)} beyond their own"
        " errors; the interval allows for it. Check the overhangs, that the ledge is"
        " level, and that all pieces are of one fabric, cut the same way, with the"
        " same side up"
    )


def _overhang_warning(bending: Bending) -> str:
    """Text that warns of strips that bend too sharply or too little to be measured
    well; empty where none does.
    """
    length = bending.bending_length.value
    sharp: list[str] = []
    stiff: list[str] = []
    for fit in bending.fits:
        photograph = fit.photograph
        # at the ledge of a limp strip
        radius = np.sqrt(length**3 / (2 * photograph.overhang))
        if radius < max(SHARP_WIDTHS * photograph.width, SHARP_RADIUS):
            sharp.append(photograph.name)
        if photograph.overhang < length and fit.sigma > LARGEST_UNCERTAINTY / 2:
            stiff.append(photograph.name)

    low, high = (1e3 * length * lengths for lengths in OVERHANGS)
    best = f"an overhang of {low:.0f} to {high:.0f} mm shows most"
    if sharp:
        return (
            f"{', '.join(sharp)}: bends too sharply at the ledge to be seen well;"
            f" {best}"
        )
    if stiff:
        return f"{', '.join(stiff)}: hardly bends; {best}"

    return ""


def _width_warning(bending: Bending) -> str:
    """Text that warns of a strip that looks much wider in one photograph than in
    another; empty where it does not.
    """
    photographs = sorted(
        (fit.photograph for fit in bending.fits), key=attrgetter("width")
    )
    thin = photographs[0]
    thick = photographs[-1]
    if thick.width < SMALLEST_WIDTH_RATIO * thin.width:
        return ""
    return (
        f"by its overhang the strip is {in_mm(thick.width, 1)} thick in {thick.name}"
        f" and {in_mm(thin.width, 1)} in {thin.name}: is each --overhang that of its"
        " --photo?"
    )


def _uncertainty_warning(bending: Bending) -> str:
    """Text that warns of a bending length that is known only within a wide interval;
    empty where the interval is narrow.
    """
    half = 0.5 * np.log(bending.bending_length.high / bending.bending_length.low)
    if half < LARGEST_UNCERTAINTY:
        return ""
    return (
        f"the bending length is only known to {in_percent(half)}; photograph more"
        " pieces"
    )


def _interval(pooled: Pooled) -> dict[str, float]:
    return {"value": pooled.value, "low": pooled.low, "high": pooled.high}


def _mm_text(pooled: Pooled) -> str:
    return (
        f"{in_mm(pooled.value, 1)} (95 %: {1e3 * pooled.low:.1f} to"
        f" {1e3 * pooled.high:.1f})"
    )
