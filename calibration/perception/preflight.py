"""One picture before grasping: does the right strip lie there, flat and well visible?"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from calibration.landmarks import CameraShift, LandmarkSettings
from calibration.perception.appearance import Appearance, Matte, matte, share, soft
from calibration.perception.settings import PerceptionSettings
from drivers.strip.file import StripFile
from drivers.types import Array, Frame, Image, frozen

FRONT = (-0.008, -0.003)  # m of height where the desk shows before the strip
BACKDROP = (0.06, 0.25)  # m of height where the backdrop shows
SEARCH = 0.008  # m above and below rest in which the underside is looked for
DEGREE = 3  # of the polynomial that the homography's remainder follows
NAN = float("nan")


@dataclass(frozen=True, slots=True)
class PreflightCheck:
    """One named check: what was found, and what to do when it failed."""

    name: str
    passed: bool
    reason: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Preflight:
    """All checks of one picture, and how things look; `appearance` is None without a strip."""

    checks: tuple[PreflightCheck, ...]
    appearance: Appearance | None

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return self.appearance is not None and all(check.passed for check in self.checks)


@dataclass(frozen=True, slots=True)
class Underside:
    """Where the strip's lower border was seen: `x` (n,) [m], midline height `z` (n,) [m] by it,
    NaN where no strip was, and `end` [m], x of the strip's free edge.
    """

    x: Array
    z: Array
    end: float

    @property
    def present(self) -> NDArray[np.bool_]:
        """Where a strip was seen."""
        return np.isfinite(self.z)


def inspect(
    frame: Frame, calibration: Calibration, settings: PerceptionSettings, strip: StripFile
) -> Preflight:
    """Checks of the picture `frame` of a strip lying flat on the desk, not yet grasped."""
    image = frame.image
    if image.shape[:2] != (calibration.lens.height, calibration.lens.width):
        found = f"the picture is {image.shape[1]} x {image.shape[0]} pixels"
        return Preflight((_size(found, calibration),), None)
    desk = _colour(image, calibration, _span(strip, 0.03), FRONT)
    backdrop = _colour(image, calibration, _span(strip, 0.0), BACKDROP)
    face = calibration.viewpoint.sweep(strip.width) * calibration.viewpoint.z
    colour = _colour(image, calibration, _span(strip, 0.05), (0.0, 0.7 * face))
    look = matte(colour, desk, backdrop)
    contrast = _contrast(look, colour, desk, backdrop, settings)
    seen = _underside(image, look, calibration, strip)
    there = float(seen.present[seen.x < strip.length - 0.01].mean())
    lies = PreflightCheck(
        "strip lies there",
        contrast.passed and there > 0.9,
        f"seen along {100 * there:.0f} % of its place",
        "lay the strip along the x-axis, its fixed edge at x = 0, its side on the marked line",
    )
    if not lies.passed:
        return Preflight((contrast, lies), None)
    rest = _rest(seen)
    appearance = Appearance(frozen(colour), frozen(desk), frozen(backdrop), frozen(rest))
    checks = (contrast, lies, *_shape(seen, appearance, settings, strip))
    return Preflight(checks, appearance)


def camera_check(shift: CameraShift, settings: LandmarkSettings) -> PreflightCheck:
    """Whether the camera stands where it was calibrated, by what its landmarks say."""
    seen = np.isfinite([shift.x, shift.z]).all()
    desk = f", the desk's line by {shift.desk:+.1f} mm" if np.isfinite(shift.desk) else ""
    moved = f"the gripper appears moved by x {shift.x:+.1f}, z {shift.z:+.1f} mm{desk}"
    return PreflightCheck(
        "camera stands where it was calibrated",
        bool(seen and shift.distance <= settings.moved_mm),
        f"{moved}, allowed {settings.moved_mm:.1f} mm" if seen else "the gripper is not seen there",
        "look whether camera, zoom, focus or robot were touched; fasten them, calibrate again",
    )


def _size(found: str, calibration: Calibration) -> PreflightCheck:
    lens = calibration.lens
    return PreflightCheck(
        "picture fits calibration",
        False,
        f"{found}, the calibration is for {lens.width} x {lens.height}",
        "set the camera to the calibrated size, or calibrate again",
    )


def _contrast(
    look: Matte, colour: Array, desk: Array, backdrop: Array, settings: PerceptionSettings
) -> PreflightCheck:
    least = float(min(np.linalg.norm(colour - desk), np.linalg.norm(colour - backdrop)))
    return PreflightCheck(
        "contrast",
        least >= settings.contrast and look.separation >= settings.separation,
        f"strip and surroundings differ by {least:.0f} grey levels, {settings.contrast:.0f} are "
        f"needed; their separation is {look.separation:.1f}, {settings.separation:.1f} is needed",
        "check that a strip lies there; change the mat, the backdrop or the light",
    )


def _shape(
    seen: Underside, appearance: Appearance, settings: PerceptionSettings, strip: StripFile
) -> tuple[PreflightCheck, ...]:
    x, z = seen.x[seen.present], seen.z[seen.present]
    bump = float(np.abs(z - appearance.rest_height(x)).max())
    high = float(np.abs(appearance.rest_height(x)).max())
    flat = PreflightCheck(
        "flat and straight",
        bump <= settings.flatness,
        f"its edge leaves a smooth line by {1e3 * bump:.1f} mm, "
        f"allowed {1e3 * settings.flatness:.1f} mm",
        "smooth the strip out, lay it straight along the line",
    )
    level = PreflightCheck(
        "on the desk plane",
        high <= settings.level,
        f"its edge lies {1e3 * high:.1f} mm off z = 0, allowed {1e3 * settings.level:.1f} mm",
        "lay the near edge on the marked line; if it is, calibrate the camera again",
    )
    error = seen.end - strip.length
    length = PreflightCheck(
        "length",
        abs(error) <= settings.length_tolerance,
        f"its free edge is at x = {1e3 * seen.end:.0f} mm, stated length "
        f"{1e3 * strip.length:.0f} mm, allowed within {1e3 * settings.length_tolerance:.0f} mm",
        "push the fixed edge to x = 0, or state the strip's own length",
    )
    return flat, level, length


def _span(strip: StripFile, margin: float) -> tuple[float, float]:
    return margin + 0.01, strip.length - margin - 0.01


def _colour(
    image: Image, calibration: Calibration, span: tuple[float, float], height: tuple[float, float]
) -> Array:
    """Median colour (3,) BGR over a rectangle of x and z [m] in the plane of the near edge."""
    grid = _grid(np.linspace(*span, 250), np.linspace(*height, 12))
    colours = _sample(image, calibration, grid).reshape(-1, 3)
    return np.asarray(np.median(colours, axis=0), dtype=np.float64)


def _sample(image: Image, calibration: Calibration, points: Array) -> Array:
    """Values of `image` (n, m) or (n, m, 3) at points (n, m, 2) of the plane [m]."""
    pixels = calibration.to_image(points.reshape(-1, 2)).reshape(points.shape)
    at = pixels.astype(np.float32)
    sampled = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float64)


def _grid(x: Array, z: Array) -> Array:
    """Points (n, m, 2) of the plane at all x (n,) and z (m,) [m]."""
    return np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)


def _underside(image: Image, look: Matte, calibration: Calibration, strip: StripFile) -> Underside:
    levels = soft(look.of(image))
    x = np.arange(0.005, strip.length + 0.06, 0.002)
    z = np.arange(-SEARCH, SEARCH, 0.0001)
    across = share(_sample(levels, calibration, _grid(x, z)))
    solid = across > 0.5
    first = solid.argmax(axis=1)
    rows = np.arange(len(x))
    before = across[rows, np.maximum(first - 1, 0)]
    part = (0.5 - before) / np.maximum(across[rows, first] - before, 1e-6)
    low = z[0] + (first - 1 + part) * (z[1] - z[0])
    found = solid.any(axis=1) & (first > 0)
    height = np.where(found, low + strip.thickness / 2, NAN)
    return Underside(x, height, _end(levels, calibration, strip))


def _end(levels: Image, calibration: Calibration, strip: StripFile) -> float:
    """x [m] of the last strip along the near edge's own line."""
    x = np.arange(0.1, strip.length + 0.06, 0.0003)
    heights = np.array([0.0, 0.0005, 0.001])
    along = share(_sample(levels, calibration, _grid(x, heights)).max(axis=1))
    inside = np.flatnonzero(along > 0.5)
    return float(x[inside[-1]]) if len(inside) else NAN


def _rest(seen: Underside) -> Array:
    """Polynomial (DEGREE + 1,) of the resting midline's height over x, robust to a bump."""
    x, z = seen.x[seen.present], seen.z[seen.present]
    kept = np.ones(len(x), dtype=bool)
    fit: Array = np.zeros(DEGREE + 1)
    for _ in range(3):
        fit = np.asarray(np.polynomial.polynomial.polyfit(x[kept], z[kept], DEGREE), np.float64)
        off = np.abs(z - np.polynomial.polynomial.polyval(x, fit))
        kept = off <= max(3.0 * float(np.median(off)), 1e-4)
    return fit
