"""Agreement of a strip with the model: a rod of the estimated strip against the images."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from cell.perception.measured_fold import MeasuredFold
from drivers.settings import Settings, load
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.prediction import Estimate, FoldPrediction
from policies.profile import POINTS, profiles

LIMITS = Path(__file__).with_suffix(".yaml")
DT = 0.005  # s of a step
SHAPE_STRIDE = 2  # steps between two shapes
SEGMENTS = 60  # segments of the rod
PASSES = 3  # of Gauss-Newton
YIELD_UNIT = 10.0  # 1/m, yield curvature that makes one unit of ln(1 + y / YIELD_UNIT)
# differences of ln length, ln time, ln(1 + y / YIELD_UNIT)
GRADIENT_STEPS = np.array([0.02, 0.2, 0.2])
SMALLEST_SIGMA = np.array([0.01, 0.15, 0.15])  # sigma of these in a belief, at least
POINT_NOISE = 0.0005  # m, of a point's median over a bin
BIAS_SIGMA, STAMP_SIGMA = 0.0005, 0.005  # m, s: sigma of the images' bias and of their stamps
IMAGE_SIGMAS = np.array([BIAS_SIGMA, BIAS_SIGMA, BIAS_SIGMA, STAMP_SIGMA])


class AgreementLimits(Settings):
    """Largest `residual` [m] and `yield_curvature` [1/m] of a fold that behaves like the model.

    Written by `cell study agreement`: what `share` of such folds stay below.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    residual: float
    yield_curvature: float
    share: float
    folds: int
    source: str
    belongs_to: str


@cache
def agreement_limits() -> AgreementLimits:
    """Limits of agreement that the package ships."""
    return load(LIMITS, AgreementLimits)


@dataclass(frozen=True, slots=True)
class Agreement:
    """Fit of a rod to a fold: rms `residual` [m] of its profiles, beyond the noise of the images,
    and the `yield_curvature` [1/m] that it needs.
    """

    residual: float
    yield_curvature: float

    @property
    def like_model(self) -> bool:
        """Whether the fold could be one of a strip that the policy was trained for."""
        most = agreement_limits()
        return self.residual <= most.residual and self.yield_curvature <= most.yield_curvature

    def sentence(self) -> str:
        """Text for the operator: what is wrong, and what to do."""
        if self.like_model:
            return f"the strip behaves like the model, within {1e3 * self.residual:.1f} mm"
        return (
            f"this strip does not behave like the model: {self._why()}; find out what it does "
            "with `cell gap plan` and `cell gap fit`"
        )

    def _why(self) -> str:
        most, off, friction = agreement_limits(), 1e3 * self.residual, self.yield_curvature
        if self.residual > most.residual:
            return f"its profile is {off:.1f} mm off, up to {1e3 * most.residual:.1f} mm are usual"
        return (
            f"its yarns rub as {friction:.0f} 1/m, up to {most.yield_curvature:.0f} 1/m are usual"
        )


def agreement(strip: StripFile, predicted: FoldPrediction, fold: MeasuredFold) -> Agreement | None:
    """Agreement of a rod like `strip`, with the parameters `predicted`, with a measured `fold`.

    The rod is fitted within the belief's intervals, with a constant bias of the images and an
    error of their stamps; what remains is neither. None where too little was measured, or where the
    rod cannot follow.
    """
    return _fit_strip(strip, predicted, fold) if fold.usable else None


def _fit_strip(strip: StripFile, predicted: FoldPrediction, fold: MeasuredFold) -> Agreement | None:
    seen = fold.bin_curves(fold.profile)
    middle = _parameters(predicted)
    sigma = np.maximum(_sigmas(predicted), SMALLEST_SIGMA)
    at, residual = middle, np.nan
    for _ in range(PASSES):
        curves = simulate_profiles(
            [_model(strip, each) for each in (at, *(at + np.diag(GRADIENT_STEPS)))], fold
        )
        if curves is None:
            return None
        design, off = _design(curves, fold.spacing), seen - curves[0]
        known = np.isfinite(off).all(axis=(1, 2)) & np.isfinite(design).all(axis=(1, 2, 3))
        if not known.any():
            return None
        change, left = _solve(design[known], off[known], at - middle, sigma)
        residual = float(np.sqrt(max((left**2).sum(axis=-1).mean() - fold.noise**2, 0.0)))
        at = at + np.clip(change, -3.0 * sigma, 3.0 * sigma)
        at[2] = max(at[2], 0.0)
    return Agreement(residual, YIELD_UNIT * float(np.expm1(at[2])))


def simulate_profiles(models: list[StripModel], fold: MeasuredFold) -> Array | None:
    """Binned profiles (n, BINS, POINTS, 2) of rods along the path of `fold`; None if one fails."""
    times = np.arange(fold.t[0] + DT, fold.t[-1] + 0.5 * DT, DT)
    path = np.stack([np.interp(times, fold.t, column) for column in fold.poses.T], axis=1)
    rod = Rod(SEGMENTS, strict=False)
    rod.reset(models)
    shown = rod.follow(np.repeat(path[:, None], len(models), axis=1), DT, SHAPE_STRIDE)
    if rod.failed.any():
        return None
    kept = slice(SHAPE_STRIDE - 1, None, SHAPE_STRIDE)
    times, grip, contact, arc = times[kept], path[kept, :2], shown.contact_x[kept], rod.arc()
    j = np.clip(np.searchsorted(times, fold.stamp) - 1, 0, len(times) - 2)
    part = ((fold.stamp - times[j]) / (times[j + 1] - times[j]))[:, None, None]
    found = []
    for i in range(len(models)):
        arcs = np.broadcast_to(arc[i], (len(times), arc.shape[1]))
        curves = profiles(shown.shapes[:, i], arcs, contact[:, i], grip)
        found.append(fold.bin_curves((1.0 - part) * curves[j] + part * curves[j + 1]))
    return np.array(found)


def _design(curves: Array, spacing: float) -> Array:
    """How a profile (BINS, POINTS, 2) responds to each of seven unknowns, the last axis: the
    strip's three parameters, shifts of all points along x and z and of the contact along x, and a
    delay.
    """
    base = curves[0]
    by_strip = [
        (curve - base) / step for curve, step in zip(curves[1:], GRADIENT_STEPS, strict=True)
    ]
    shifts = np.zeros((3, *base.shape))
    shifts[0, :, :-1, 0] = shifts[1, :, :-1, 1] = shifts[2, :, 0, 0] = 1.0
    return np.stack([*by_strip, *shifts, np.gradient(base, spacing, axis=0)], axis=-1)


def _solve(design: Array, off: Array, gone: Array, sigma: Array) -> tuple[Array, Array]:
    """Change of the parameters (3,) that explains `off` (b, POINTS, 2) best, and what it leaves.

    `gone` (3,) is how far they are from the belief already, `sigma` (3,) the belief's.
    """
    prior = np.concatenate([sigma, IMAGE_SIGMAS])
    a, b = design.reshape(-1, len(prior)), off.ravel()
    rows = np.vstack([a / POINT_NOISE, np.diag(1.0 / prior)])
    wanted = np.concatenate(
        [b / POINT_NOISE, -np.concatenate([gone, np.zeros(len(IMAGE_SIGMAS))]) / prior]
    )
    change = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return change[: len(sigma)], (b - a @ change).reshape(-1, POINTS, 2)


def _model(strip: StripFile, at: Array) -> StripModel:
    """Model of the strip with the parameters `at` (3,); its other effects stay."""
    effects = {name: given for name, given in strip.effects.items() if name != "bending_hysteresis"}
    friction = YIELD_UNIT * float(np.expm1(max(at[2], 0.0)))
    if friction > 0:
        effects["bending_hysteresis"] = {"yield_curvature": friction}
    changed = {"bending_length": float(np.exp(at[0])), "retardation_time": float(np.exp(at[1]))}
    return describe(strip.model_copy(update={**changed, "effects": effects}))


def _parameters(predicted: FoldPrediction) -> Array:
    friction = np.log1p(predicted.yield_curvature.value / YIELD_UNIT)
    lengths = predicted.bending_length.value, predicted.retardation_time.value
    return np.array([*np.log(lengths), friction])


def _sigmas(predicted: FoldPrediction) -> Array:
    def half(estimate: Estimate) -> float:
        return 0.5 * float(np.log(estimate.high / estimate.low))

    friction = predicted.yield_curvature
    low, high = (np.log1p(value / YIELD_UNIT) for value in (friction.low, friction.high))
    times = half(predicted.bending_length), half(predicted.retardation_time)
    return np.array([*times, 0.5 * (high - low)])
