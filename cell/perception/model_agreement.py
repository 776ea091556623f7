"""Agreement of a strip with its model: fits a simulated rod to profiles measured in
images.
"""

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from drivers.base.errors import in_mm
from drivers.base.geometry import MAD, interpolate_columns
from drivers.base.settings import StudyResult
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from policies.policy import FoldPrediction
from policies.profile import POINTS, profiles

BINS = 12  # of time, in which the noise of the images averages out
FEWEST_IMAGES = 3  # images in a bin that counts
TOUCH_MARGIN = 0.03  # s before the touch without images: the layers hide each other


class MeasuredFold(NamedTuple):
    """Gripper path and strip profiles of one fold, measured from the rest to the
    layers' touch.

    Gripper `poses` (m, 3) at times `t` (m,) [s]; `profile` (k, POINTS, 2) [m] at the
    stamps `stamp` (k,) [s], from the take-over to just before the touch.
    """

    t: Array
    poses: Array
    stamp: Array
    profile: Array

    @classmethod
    def until(
        cls, touch: float, t: Array, poses: Array, stamp: Array, profile: Array
    ) -> Self:
        """Measured fold with the gripper poses (m, 3) and profiles (k, POINTS, 2) taken
        before the time `touch` [s].
        """
        usable = (stamp < touch - TOUCH_MARGIN) & np.isfinite(profile).all(axis=(1, 2))
        before = t <= touch
        return cls(
            t=t[before],
            poses=poses[before],
            stamp=stamp[usable],
            profile=profile[usable],
        )

    def bin_curves(self, curves: Array) -> Array:
        """Robust mean (BINS, POINTS, 2) of `curves` (k, POINTS, 2) in each time bin;
        NaN where few.

        A linear motion is removed before the median, which would otherwise rest on the
        few images in the bin's middle.
        """
        since = self.stamp - self.stamp[0]
        fraction = since / max(since[-1], 1e-9)
        bins = np.minimum((BINS * fraction).astype(np.intp), BINS - 1)
        means = np.full((BINS, POINTS, 2), np.nan)

        for i in range(BINS):
            inside = bins == i
            if np.count_nonzero(inside) >= FEWEST_IMAGES:
                rows = curves[inside]
                t = self.stamp[inside]
                t = t - t.mean()
                rate = np.tensordot(t, rows, axes=1) / (t @ t)
                means[i] = np.median(rows - t[:, None, None] * rate, axis=0)
        return means

    @property
    def noise(self) -> float:
        """Noise [m] of a point of a binned profile: root mean square of x and z
        together.
        """
        steps = np.abs(np.diff(self.profile, n=2, axis=0))  # removes a uniform motion
        # variances of 1, -2, 1 add to 6
        sigma = MAD * np.median(steps, axis=0) / np.sqrt(6.0)
        # of a median of a bin's images
        variance_share = 0.5 * np.pi * BINS / len(self.stamp)
        return float(np.sqrt(variance_share * (sigma**2).sum(axis=-1).mean()))

    @property
    def spacing(self) -> float:
        """Time [s] between neighbouring bins of the profiles."""
        return float(self.stamp[-1] - self.stamp[0]) / BINS


DT = 0.005  # s of a step
SHAPE_STRIDE = 2  # steps between two shapes
SEGMENTS = 60  # segments of the rod
PASSES = 3  # of Gauss-Newton
YIELD_UNIT = 10.0  # 1/m, yield curvature that makes one unit of ln(1 + y / YIELD_UNIT)
# differences of ln length, ln time, ln(1 + y / YIELD_UNIT)
GRADIENT_STEPS = np.array([0.02, 0.2, 0.2])
SMALLEST_SIGMA = np.array([0.01, 0.15, 0.15])  # sigma of these in a belief, at least
POINT_NOISE = 0.0005  # m, of a point's median over a bin
BIAS_SIGMA = 0.0005  # m, sigma of the images' bias
STAMP_SIGMA = 0.005  # s, sigma of their stamps
IMAGE_SIGMAS = np.array([BIAS_SIGMA, BIAS_SIGMA, BIAS_SIGMA, STAMP_SIGMA])


class AgreementLimits(StudyResult):
    """Largest `residual` [m] and `yield_curvature` [1/m] of a strip that behaves like
    its model.

    Written by `python -m tests.lab study unknown`: a `share` of such folds stays
    below.
    """

    FILE = Path(__file__).with_suffix(".yaml")
    residual: float
    yield_curvature: float
    share: float
    folds: int


@dataclass(frozen=True, slots=True)
class Agreement:
    """Fit of a rod to a fold: rms `residual` [m] beyond noise, fitted `yield_curvature`
    [1/m].
    """

    residual: float
    yield_curvature: float

    @property
    def like_model(self) -> bool:
        """Whether the fit's residual and yield curvature are within their limits, so
        that the model applies.
        """
        limits = AgreementLimits.shipped()
        return (
            self.residual <= limits.residual
            and self.yield_curvature <= limits.yield_curvature
        )

    def sentence(self) -> str:
        """Text for the operator: whether the strip behaves like its model, and what to
        do.
        """
        if self.like_model:
            return f"the strip behaves like the model, within {in_mm(self.residual, 1)}"
        return (
            f"this strip does not behave like the model: {self._reason()}; find out"
            " what it does with `cell gap plan` and `cell gap fit`"
        )

    def _reason(self) -> str:
        """Words that name which value of the fit is beyond its limit."""
        limits = AgreementLimits.shipped()
        if self.residual > limits.residual:
            usual = f"up to {in_mm(limits.residual, 1)} are usual"
            return f"its profile is {in_mm(self.residual, 1)} off, {usual}"
        usual = f"up to {limits.yield_curvature:.0f} 1/m are usual"
        return f"its yarns rub as {self.yield_curvature:.0f} 1/m, {usual}"


def agreement(
    strip: StripFile, predicted: FoldPrediction, fold: MeasuredFold
) -> Agreement | None:
    """Fit a rod like `strip` to a measured `fold`, from the policy's `predicted`
    parameters.

    The parameters stay near their predicted intervals; a constant bias of the images
    and an error of their stamps are fitted too, by Gauss-Newton. None where too little
    was measured, or where the rod cannot follow.
    """
    if len(fold.t) < 2 or len(fold.stamp) < BINS * FEWEST_IMAGES:
        return None
    measured = fold.bin_curves(fold.profile)
    prior, sigma = _prior(predicted)
    unknowns = prior
    residual = np.nan
    for _ in range(PASSES):
        curves = _curves_about(strip, unknowns, fold)
        if curves is None:
            return None
        design = _design(curves, fold.spacing)
        errors = measured - curves[0]
        seen = np.isfinite(errors).all(axis=(1, 2))
        valid = seen & np.isfinite(design).all(axis=(1, 2, 3))
        if not valid.any():
            return None

        from_prior = unknowns - prior
        change, remaining = _solve(design[valid], errors[valid], from_prior, sigma)
        square = (remaining**2).sum(axis=-1).mean()
        residual = np.sqrt(max(square - fold.noise**2, 0.0))
        unknowns = unknowns + np.clip(change, -3.0 * sigma, 3.0 * sigma)
        unknowns[2] = max(unknowns[2], 0.0)  # friction is not negative
    return Agreement(float(residual), YIELD_UNIT * float(np.expm1(unknowns[2])))


def _curves_about(
    strip: StripFile, unknowns: Array, fold: MeasuredFold
) -> Array | None:
    """Profiles of the rod at the parameters `unknowns` (3,), and with each one changed
    by its step; None where the rod cannot follow one of them.
    """
    changed = unknowns + np.diag(GRADIENT_STEPS)
    curves = []
    for each in (unknowns, *changed):
        curve = _simulate_profile(_model(strip, each), fold)
        if curve is None:
            return None
        curves.append(curve)
    return np.array(curves)


def _prior(predicted: FoldPrediction) -> tuple[Array, Array]:
    """Mean and standard deviation (3,) of the fit's unknowns, as a policy has predicted
    them.
    """
    estimates = (
        predicted.bending_length,
        predicted.retardation_time,
        predicted.yield_curvature,
    )
    spans = zip(*map(astuple, estimates), strict=True)
    value, low, high = (_unknowns(*each) for each in spans)
    # half of each predicted interval
    return value, np.maximum(0.5 * (high - low), SMALLEST_SIGMA)


def _simulate_profile(model: StripModel, fold: MeasuredFold) -> Array | None:
    """Binned profile (BINS, POINTS, 2) [m] of a rod simulated by `model`; None on
    failure.
    """
    times = np.arange(fold.t[0] + DT, fold.t[-1] + 0.5 * DT, DT)
    path = interpolate_columns(times, fold.t, fold.poses)
    # a batch of one, as the preflight has compiled it
    rod = Rod(SEGMENTS, strict=False)
    rod.reset([model])
    motion = rod.trace(path[:, None], DT, SHAPE_STRIDE)
    if rod.failed.any():
        return None

    # the steps of which there are shapes
    with_shape = slice(SHAPE_STRIDE - 1, None, SHAPE_STRIDE)
    times = times[with_shape]
    arcs = rod.arc().repeat(len(times), axis=0)
    contact = motion.contact_x[with_shape, 0]
    curves = profiles(motion.shapes[:, 0], arcs, contact, path[with_shape, :2])

    columns = curves.reshape(len(times), -1)
    seen = interpolate_columns(fold.stamp, times, columns)
    return fold.bin_curves(seen.reshape(-1, POINTS, 2))


def _design(curves: Array, spacing: float) -> Array:
    """Jacobian (BINS, POINTS, 2, 7) of a binned profile with respect to seven unknowns.

    These are the strip's three parameters, shifts of the points along x and z and of
    the contact along x, and a delay.
    """
    base = curves[0]
    by_strip = [
        (curve - base) / step
        for curve, step in zip(curves[1:], GRADIENT_STEPS, strict=True)
    ]
    shifts = np.zeros((3, *base.shape))
    # the last point is the gripper's, which the arm measures without the images' bias
    shifts[0, :, :-1, 0] = shifts[1, :, :-1, 1] = shifts[2, :, 0, 0] = 1.0
    return np.stack([*by_strip, *shifts, np.gradient(base, spacing, axis=0)], axis=-1)


def _solve(
    design: Array, off: Array, moved: Array, sigma: Array
) -> tuple[Array, Array]:
    """Least-squares change (3,) of the fitted parameters, and the residuals (b, POINTS,
    2) that remain after it.

    `off` (b, POINTS, 2) are the residuals before it, `moved` (3,) is the parameters'
    distance from their prior so far, `sigma` (3,) the prior's standard deviation.
    """
    prior = np.concatenate([sigma, IMAGE_SIGMAS])
    distance = np.concatenate([moved, np.zeros(len(IMAGE_SIGMAS))])
    a = design.reshape(-1, len(prior))
    b = off.ravel()
    rows = np.vstack([a / POINT_NOISE, np.diag(1.0 / prior)])
    target = np.concatenate([b / POINT_NOISE, -distance / prior])
    change = np.linalg.lstsq(rows, target, rcond=None)[0]
    remaining = b - a @ change
    return change[: len(sigma)], remaining.reshape(-1, POINTS, 2)


def _model(strip: StripFile, unknowns: Array) -> StripModel:
    """Model of `strip` with its bending length, retardation time and friction from the
    fitted `unknowns` (3,).
    """
    ln_length, ln_time, ln_friction = unknowns.tolist()
    effects = dict(strip.effects)
    effects.pop("bending_hysteresis", None)
    friction = YIELD_UNIT * float(np.expm1(max(ln_friction, 0.0)))  # 1/m
    if friction > 0:
        effects["bending_hysteresis"] = {"yield_curvature": friction}
    changed = {
        "bending_length": float(np.exp(ln_length)),
        "retardation_time": float(np.exp(ln_time)),
        "effects": effects,
    }
    return describe(strip.model_copy(update=changed))


def _unknowns(length: float, time: float, friction: float) -> Array:
    """Unknowns (3,) of the fit: ln of the bending `length` [m], ln of the retardation
    `time` [s], ln(1 + `friction` [1/m] / YIELD_UNIT).
    """
    return np.array([np.log(length), np.log(time), np.log1p(friction / YIELD_UNIT)])
