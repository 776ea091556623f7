"""Checks of the image before the grasp: the right strip lies there, flat and well
visible.
"""

from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

import cv2
import numpy as np

from calibration.calibration import Calibration
from calibration.homography import PlaneMap
from calibration.view import Landmarks, LandmarkSettings, PinnedView
from cell.perception import resting_strip, scene
from cell.perception.kernels import ZERO_LEVEL, Floats, smooth_matte
from cell.perception.length_checks import BY_HAND, LengthCheck
from cell.perception.region import Region, motion_mask, still_surroundings
from drivers.base.errors import in_mm, in_percent
from drivers.base.types import Array, Frame, Image, Pose, frozen
from drivers.strip.file import StripFile

# share of the background above which a match is the background, not the strip
MOSTLY = 0.5
# m, both ends folded through images, within 1 mm of the truth
WIDTH_RANGE = (0.005, 0.20)
THICKNESS_RANGE = (0.0, 0.004)  # m
WHITE_LEVEL, BLACK_LEVEL = 252.0, 12.0  # grey levels from which a pixel has no colour
BURNT = 0.1  # share of pixels that may be so
SOLID = 0.5  # matte level that every part of the strip reaches
ALIKE_SHARE = 0.04  # share of the background that may look like the strip
# standard deviations, separation of the strip's colour from the background
SEPARATION = 3.0
DESK_SEPARATION = 4.0  # likewise, from the desk
DESK_CONTRAST = 30.0  # grey levels between strip and desk
FLATNESS = 0.003  # m, worst height of a flat strip
LEVEL = 0.0015  # m, by which it may lie off z = 0
# m above z = 0, at which a strip is sought that is not seen there
RISES = (-0.003, 0.003, -0.0045, 0.0045, -0.006, 0.006)
LENGTH_TOLERANCE = 0.006  # m, of the stated length
END_LENGTH = 0.01  # m at the free edge that may be hidden
PRESENT_SHARE = 0.9  # share of its place along which the strip must be visible
TIP_REACH = (-48, 48)  # px about the gripper's tip by which it is found again
CAMERA_WATCHED = "camera is watched"  # name of the check
UNWATCHED = "camera is not watched"  # its name where too few patches are known
BLOT_SIZE = 61  # px, window in which pixels like the strip are counted


@dataclass(frozen=True, slots=True)
class PreflightCheck:
    """Result of one check before the grasp: `reason` is its finding, `remedy` is for a
    failure.
    """

    name: str
    passed: bool
    reason: str
    remedy: str
    witness: LengthCheck | None = None

    def sentence(self) -> str:
        """Text for the operator: name of the check, its finding, its remedy."""
        return f"{self.name}: {self.reason}; {self.remedy}"


def _check_size(image: Image, calibration: Calibration) -> PreflightCheck:
    """Check whether the image (h, w, 3) has the calibration's size."""
    shape = image.shape
    lens = calibration.lens
    return PreflightCheck(
        name="picture fits calibration",
        passed=lens.fits(image),
        reason=(
            f"the picture is {shape[1]} x {shape[0]} pixels, "
            f"the calibration is for {lens.width} x {lens.height}"
        ),
        remedy="set the camera to the calibrated size, or calibrate again",
    )


def check_scope(strip: StripFile) -> tuple[PreflightCheck, ...]:
    """Check whether perception is validated for a strip as wide and as thick as
    `strip`.
    """
    return tuple(
        PreflightCheck(
            name=key,
            passed=low <= value <= high,
            reason=(
                f"is {1e3 * value:g} mm, images are read of strips of {1e3 * low:g} to "
                f"{1e3 * high:g} mm"
            ),
            remedy=(
                f"fold another cut of the fabric, or correct `{key}` in the strip's"
                " file"
            ),
        )
        for key, value, (low, high) in (
            ("width", strip.width, WIDTH_RANGE),
            ("thickness", strip.thickness, THICKNESS_RANGE),
        )
    )


def _check_desk(segmenter: scene.Segmenter, desk: Array) -> PreflightCheck:
    """Check whether each of the strip's colours differs from the desk (3,), lit or in
    shadow.
    """
    apart = np.linalg.norm(segmenter.colours - desk, axis=1).min()
    shade = np.array([scene.DESK_SHADE], dtype=np.float32)
    away = min(
        scene.separation(colour, desk[None], shade, segmenter.smooth)[0]
        for colour in segmenter.colours
    )
    mostly = "" if away >= DESK_SEPARATION else ", mostly as a desk and its shadow do"
    return PreflightCheck(
        name="contrast",
        passed=bool(apart >= DESK_CONTRAST and away >= DESK_SEPARATION),
        reason=(
            f"strip and desk differ by {apart:.0f} grey levels{mostly},"
            f" {DESK_CONTRAST:.0f} are needed; their separation is {away:.1f},"
            f" {DESK_SEPARATION:.1f} is needed"
        ),
        remedy=(
            "check that a strip lies there; lay a mat under it that has another colour,"
            " not only another brightness"
        ),
    )


def _check_solid(
    levels: Image, calibration: Calibration, strip: StripFile, rise: float
) -> PreflightCheck:
    """Check whether every part of the strip stands out from the desk in the image of
    strip fractions (h, w).

    The strip's midline rests at a height `rise` [m].
    """
    least = float(
        np.quantile(resting_strip.strip_shares(levels, calibration, strip, rise), 0.05)
    )
    return PreflightCheck(
        name="solid",
        passed=least >= SOLID,
        reason=(
            f"where it shows least, {in_percent(max(least, 0.0))} of the strip stands"
            f" out from the desk, {in_percent(SOLID)} are needed"
        ),
        remedy=(
            "part of its pattern looks like the desk: lay a mat under it that differs"
            " from each of its colours"
        ),
    )


def _check_background(
    segmenter: scene.Segmenter, calibration: Calibration, strip: StripFile
) -> PreflightCheck:
    """Check whether the background along the strip's motion differs from the strip's
    colours.
    """
    mask = motion_mask(calibration, strip.length)
    alike = (segmenter.separation(mask) < SEPARATION).mean(axis=0)
    share = alike.mean()
    likeness = np.zeros(mask.shape, dtype=np.float32)
    likeness[mask > 0] = alike
    x, z = calibration.to_plane(_densest_pixel(likeness)[None])[0]
    if share > MOSTLY:
        return PreflightCheck(
            name="contrast",
            passed=False,
            reason=(
                f"what lies in the strip's place looks like {in_percent(share)} of the "
                "background"
            ),
            remedy=(
                "check that a strip lies there, its side on the marked line; if it"
                " does, hang a cloth of another colour behind the desk"
            ),
        )

    return PreflightCheck(
        name="background",
        passed=bool(share <= ALIKE_SHARE),
        reason=(
            f"{in_percent(share)} of what is behind the strip's way has its colour,"
            f" allowed {in_percent(ALIKE_SHARE)}; most of it at x = {in_mm(x)}, z"
            f" = {in_mm(z)}"
        ),
        remedy=(
            "take away or cover what stands there, or hang a cloth of another colour"
            " behind the desk"
        ),
    )


def _check_exposure(samples: resting_strip.SceneSamples) -> PreflightCheck:
    """Check whether strip, desk and backdrop are neither over- nor underexposed."""
    pixels = np.vstack([samples.strip, samples.desk, samples.backdrop])
    white = (pixels > WHITE_LEVEL).any(axis=1).mean()
    black = (pixels < BLACK_LEVEL).all(axis=1).mean()
    return PreflightCheck(
        name="exposure",
        passed=max(white, black) <= BURNT,
        reason=(
            f"{in_percent(white)} of the picture is burnt out and {in_percent(black)}"
            f" black, allowed {in_percent(BURNT)} of each"
        ),
        remedy=(
            "expose shorter where it is burnt out, longer or with more light where it"
            " is black"
        ),
    )


def _check_presence(
    edge: resting_strip.Underside, strip: StripFile, *, clear: bool
) -> PreflightCheck:
    """Check whether the strip is visible along its expected position; `clear` marks
    visible parts.
    """
    share = float(edge.present[edge.x < strip.length - END_LENGTH].mean())
    return PreflightCheck(
        name="strip lies there",
        passed=clear and share > PRESENT_SHARE,
        reason=f"seen along {in_percent(share)} of its place",
        remedy=(
            "lay the strip along the x-axis, its fixed edge at x = 0, its side on the"
            " marked line"
        ),
    )


def _check_flat(
    edge: resting_strip.Underside, appearance: scene.Appearance
) -> PreflightCheck:
    """Check whether the strip's edge leaves its smooth line by at most FLATNESS."""
    bump = float(np.abs(edge.z - appearance.rest_height(edge.x))[edge.present].max())
    return PreflightCheck(
        name="flat and straight",
        passed=bump <= FLATNESS,
        reason=(
            f"its edge leaves a smooth line by {in_mm(bump, 1)},"
            f" allowed {in_mm(FLATNESS, 1)}"
        ),
        remedy="smooth the strip out, lay it straight along the line",
    )


def _check_level(
    edge: resting_strip.Underside, appearance: scene.Appearance
) -> PreflightCheck:
    """Check whether the strip's edge lies at most LEVEL off the desk's plane z = 0."""
    off = float(max(appearance.rest_height(edge.x[edge.present]), key=abs))
    return PreflightCheck(
        name="on the desk plane",
        passed=abs(off) <= LEVEL,
        reason=(
            f"its edge lies {1e3 * off:+.1f} mm off z = 0, allowed {in_mm(LEVEL, 1)}"
        ),
        remedy=(
            "lay the near edge on the marked line; if it is, calibrate the camera again"
        ),
    )


def _check_length(
    edge: resting_strip.Underside, strip: StripFile, residual: float
) -> PreflightCheck:
    """Check whether the free edge lies within LENGTH_TOLERANCE of the strip's stated
    length.

    `residual` [m] is the error of the calibration's map.
    """
    error = edge.end - strip.length
    return PreflightCheck(
        name="length",
        passed=abs(error) <= LENGTH_TOLERANCE,
        reason=(
            f"its free edge is at x = {in_mm(edge.end)}, stated length"
            f" {in_mm(strip.length)}, allowed within {in_mm(LENGTH_TOLERANCE)}"
        ),
        remedy=(
            "push the fixed edge to x = 0, or state the strip's own length; if both are"
            " right, calibrate the camera again"
        ),
        witness=LengthCheck("free_edge", error, hypot(residual, BY_HAND)),
    )


def _densest_pixel(alike: Floats) -> Array:
    """Pixel (2,), u and v, around which most of the mask `alike` (h, w) lies."""
    near = cv2.blur(alike, (BLOT_SIZE, BLOT_SIZE))
    _, _, _, (u, v) = cv2.minMaxLoc(near)
    return np.array([float(u), float(v)])


def check_camera(
    image: Image,
    landmarks: Landmarks,
    calibration: Calibration,
    strip: StripFile,
    settings: LandmarkSettings,
) -> PreflightCheck:
    """Check whether the camera was moved since it took its `landmarks`, by an `image`
    (h, w, 3) of the empty hand at their pose: by the gripper, and by what stands still.
    """
    picture = landmarks.picture()
    for seen in (picture, image):
        fits = _check_size(seen, calibration)
        if not fits.passed:
            return fits
    tip_view, tip = _tip_view(picture, landmarks.pose, calibration)
    hand = tip_view.motion(image)
    still = still_surroundings(calibration, strip.length)
    desk = PinnedView.choose(picture, still).motion(image)

    reason, passed = "the gripper is not seen there", False
    if hand is not None:
        x, z = (1e3 * hand.in_plane(tip, calibration)[0]).tolist()
        distance = hypot(x, z)
        reason = f"the gripper appears moved by x {x:+.1f}, z {z:+.1f} mm"
        if desk is not None:
            most = 1e3 * desk.largest_in_plane(calibration)
            distance = max(distance, most)
            reason += f", the desk by at most {most:.1f} mm"
        reason += f", allowed {settings.moved_mm:.1f} mm"
        passed = distance <= settings.moved_mm
    return PreflightCheck(
        name="camera stands where it was calibrated",
        passed=passed,
        reason=reason,
        remedy=(
            "look whether camera, zoom, focus or robot were touched; fasten them,"
            " calibrate again"
        ),
    )


def _tip_view(
    image: Image, pose: Pose, plane_map: PlaneMap
) -> tuple[PinnedView, Array]:
    """View of the gripper's tip at `pose` in `image` (h, w, 3), and its place (1, 2)
    [px].
    """
    tip = plane_map.to_image(np.array([[pose.x, pose.z]]))
    mask = np.zeros(image.shape[:2], np.uint8)
    first, last = (np.rint(tip[0] + side).astype(int).tolist() for side in TIP_REACH)
    cv2.rectangle(mask, first, last, 255, cv2.FILLED)
    return PinnedView.choose(image, mask), tip


def has_tip(image: Image, pose: Pose, plane_map: PlaneMap) -> bool:
    """Whether `image` (h, w, 3) shows the gripper at `pose` so that it can be found
    again.
    """
    return _tip_view(image, pose, plane_map)[0].motion(image) is not None


def check_watch(view: PinnedView, image: Image) -> PreflightCheck:
    """Passing check that states whether motion of the camera would be noticed: whether
    the `view` is found again in its own `image` (h, w, 3).
    """
    name = CAMERA_WATCHED
    reason = f"{len(view.patches)} static patches are visible"
    if view.motion(image) is None:
        name = UNWATCHED
        reason += ", too few: a camera that is nudged in this fold would not be noticed"
    return PreflightCheck(
        name=name,
        passed=True,
        reason=reason,
        remedy=(
            "put something with a pattern where the strip does not hide it, or"
            " light it better"
        ),
    )


# m about the resting strip: before its height is known, then its blur
MARGINS = (0.005, 0.002)


@dataclass(frozen=True, slots=True)
class Preflight:
    """Checks of one image, and the `appearance` learnt from it; None where no strip is
    visible.
    """

    checks: tuple[PreflightCheck, ...]
    appearance: scene.Appearance | None


def inspect(frame: Frame, calibration: Calibration, strip: StripFile) -> Preflight:
    """Check the image `frame` of a strip that lies flat on the desk, not yet
    grasped.
    """
    image = frame.image
    required = (_check_size(image, calibration), *check_scope(strip))
    refused = tuple(check for check in required if not check.passed)
    if refused:
        return Preflight(refused, appearance=None)

    first = _inspect_at(image, calibration, strip)
    if first.appearance is not None:
        return first

    # on z = 0 of a map that is off, the desk lies where a thin strip should: what is
    # seen elsewhere says why, and never passes
    elsewhere = (_inspect_at(image, calibration, strip, rise) for rise in RISES)
    seen = next((each for each in elsewhere if each.appearance is not None), first)
    return first if all(check.passed for check in seen.checks) else seen


def _inspect_at(
    image: Image, calibration: Calibration, strip: StripFile, rise: float = 0.0
) -> Preflight:
    """Check the `image` (h, w, 3) of a strip that is sought at a height `rise` [m]."""
    learnt = _learn_scene(image, calibration, strip, rise)
    samples = resting_strip.sample_scene(image, calibration, strip, rise)
    distinct = (
        _check_exposure(samples),
        _check_desk(learnt.segmenter, samples.desk_colour),
        _check_background(learnt.segmenter, calibration, strip),
        _check_solid(learnt.levels, calibration, strip, max(learnt.rise, rise)),
    )
    edge = learnt.edge
    presence = _check_presence(
        edge, strip, clear=all(check.passed for check in distinct)
    )
    if not presence.passed:
        return Preflight((*distinct, presence), appearance=None)

    appearance = scene.Appearance(
        learnt.segmenter, frozen(resting_strip.resting_line(edge))
    )
    rests = (
        _check_flat(edge, appearance),
        _check_level(edge, appearance),
        _check_length(edge, strip, calibration.residual),
    )
    return Preflight((*distinct, presence, *rests), appearance)


class LearntScene(NamedTuple):
    """Segmenter learnt from an image of a strip at rest, and the strip's position in
    that image.

    `levels` (h, w) are the smoothed matte; `edge` the strip's near edge along its
    underside, and `rise` [m] the edge's median height.
    """

    segmenter: scene.Segmenter
    levels: Image
    edge: resting_strip.Underside
    rise: float


def _learn_scene(
    image: Image, calibration: Calibration, strip: StripFile, rise: float
) -> LearntScene:
    """Learn the background of `image` (h, w, 3) pixel by pixel, and the strip's
    colours, first about a height `rise` [m].

    Twice, since where the strip rests follows from the first time.
    """
    noise = scene.sensor_noise(image)
    sought = rise
    for margin in MARGINS:
        resting = scene.resting_place(calibration, strip, rise, margin)
        segmenter = scene.learn_segmenter(image, noise, calibration, strip, resting)
        levels = smooth_matte(_matte_of(segmenter, image))
        edge = resting_strip.underside(levels, calibration, strip, sought)
        if edge.present.any():
            rise = float(np.median(edge.z[edge.present]))
    return LearntScene(segmenter, levels, edge, rise)


def _matte_of(segmenter: scene.Segmenter, image: Image) -> Image:
    """Grey levels (h, w) that state how much strip is in each pixel of `image` (h, w,
    3), where no hand hides the strip.
    """
    levels = np.full(image.shape[:2], ZERO_LEVEL, np.uint8)
    part, region = segmenter.levels(
        image, Region.whole(image), np.full_like(levels, 255)
    )
    region.crop(levels)[:] = part
    return levels
