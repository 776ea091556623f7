"""Measurement of one strip in camera frames: desk contact, profile, fold tip, gap of
layers.
"""

from dataclasses import dataclass
from math import nan
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.kernels import LEVEL_SPAN, ZERO_LEVEL, smooth_matte, strip_share
from cell.perception.profile import SPACING, Geometry, midline_points, resample
from cell.perception.region import (
    STRIP_START,
    Region,
    Sizes,
    strip_region,
    strip_zone,
    without_hand,
)
from cell.perception.scene import Appearance
from cell.perception.silhouette import FingerZone, outer_side, silhouette
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.geometry import arc_lengths, lengths
from drivers.base.types import Array, Frame, Image, Pose
from drivers.franka.shapes import TIP_AHEAD
from drivers.strip.file import StripFile
from drivers.strip.model import CONTACT_HEIGHT
from drivers.strip.shape import LYING_LENGTH, LayerGap, fold_tip, layer_gap

SAMPLE_SPACING = 0.0003  # m between samples along the line
FRONT_HEIGHT = -0.005  # m of height where desk shows before the strip
FRONT_STRIDE = 20  # samples of the line to a point in front of it, every 6 mm
AVERAGE = 9  # samples over which a sample is averaged against noise
# samples of strip that must come before, and of desk that must follow: 4 mm
SURE_COUNT = 13
HALF_LEVEL = ZERO_LEVEL + LEVEL_SPAN // 2  # level of which half is strip


@dataclass(frozen=True, slots=True)
class SearchLine:
    """Line of sample points along the strip's underside, on which the desk contact is
    searched.

    `x` (n,) [m] and raw image points `pixels` (n, 2), projected once; `front` (k, 2)
    [px] lie on the desk in front of the strip, where no strip can be.
    """

    x: Array
    pixels: Array
    front: Array

    @classmethod
    def under(
        cls, strip: StripFile, calibration: Calibration, appearance: Appearance
    ) -> Self:
        """Search line along the underside of the resting `strip`, CONTACT_HEIGHT above
        where it rests.
        """
        x = np.arange(STRIP_START + 0.0005, strip.length + 0.01, SAMPLE_SPACING)
        z = appearance.rest_height(x) + CONTACT_HEIGHT - strip.thickness / 2
        # some points in front of the strip's fixed half
        near = x[: len(x) // 2 : FRONT_STRIDE]
        front = np.column_stack([near, np.full_like(near, FRONT_HEIGHT)])
        pixels = calibration.to_image(np.column_stack([x, z]))
        return cls(x, pixels, calibration.to_image(front))


@dataclass(frozen=True, slots=True)
class DeskContact:
    """Desk contact, where the strip leaves the desk: `x` [m], NaN if hidden; confidence
    0 to 1.
    """

    x: float
    confidence: float


def find_contact(levels: Image, line: SearchLine, origin: Array) -> DeskContact:
    """Find the desk contact: the last point along `line` at which the lying strip ends.

    As `drivers.strip.shape.desk_contact` defines it, so that a hump over a crease is no
    contact. In images that are shifted the line begins beside the strip, and crosses
    its end.
    `levels` (h, w) is the smoothed matte of the window whose first pixel is `origin`
    (2,) [px].
    """
    desk = _sample(levels, line.front - origin)
    if (desk > HALF_LEVEL).mean() > 0.5:  # all looks like strip
        return DeskContact(nan, confidence=0.0)

    along = strip_share(_average(_sample(levels, line.pixels - origin)))
    strip = along > 0.5
    ends = _piece_ends(strip)
    if len(ends) == 0 or not strip[: len(strip) // 8].any():
        return DeskContact(nan, confidence=0.0)

    i = _lying_end(ends, np.flatnonzero(strip))
    if i == len(strip) - 1:
        return DeskContact(float(line.x[-1]), confidence=1.0)

    part = (along[i] - 0.5) / max(along[i] - along[i + 1], 1e-6)
    confidence = _sharpness(along, i, 4 * SURE_COUNT)
    return DeskContact(float(line.x[i] + part * SAMPLE_SPACING), confidence)


def _piece_ends(strip: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Indices (k,) at which pieces of strip end in the mask `strip` (n,), its last
    index included where that is strip.
    """
    # in the run up to each sample
    counts = np.convolve(strip, np.ones(SURE_COUNT), mode="full")
    before = counts[: len(strip)]
    following = counts[SURE_COUNT - 1 :]
    sure = (before[:-1] >= SURE_COUNT - 1) & (following[1:] == 0)
    return np.flatnonzero(strip & np.append(sure & ~strip[1:], True))


def _lying_end(ends: NDArray[np.int64], strip: NDArray[np.int64]) -> int:
    """Index of the last sample of the last piece of strip along a line that is at least
    LYING_LENGTH long.

    Pieces end at the samples `ends` (k,), of `strip` (n,) that show strip; else that of
    the first.
    """
    begins = strip[np.searchsorted(strip, ends[:-1] + 1)]
    lying = ends[1:][(ends[1:] - begins) * SAMPLE_SPACING >= LYING_LENGTH]
    return int(np.append(ends[0], lying)[-1])


def _sharpness(along: Array, end: int, reach: int) -> float:
    """Confidence, 0 to 1, that strip ends after sample `end`, by the step in strip
    `along` (n,).

    It is 0 for a step of 0.3, and 1 for 0.8, over `reach` samples to either side.
    """
    before = along[max(end - reach, 0) : end + 1].max()
    after = along[end + 1 : end + reach].min()
    return float(np.clip(2 * (before - after) - 0.6, 0.0, 1.0))


def _sample(levels: Image, pixels: Array) -> Image:
    """Grey levels (n,) of `levels` (h, w) at `pixels` (n, 2), ZERO_LEVEL outside."""
    at = pixels.astype(np.float32)[None]
    sampled: Image = cv2.remap(
        levels, at, None, cv2.INTER_LINEAR, borderValue=ZERO_LEVEL
    )
    return sampled.ravel()


def _average(values: Image) -> Array:
    """Moving average (n,) of `values` (n,) over AVERAGE samples, the ends repeated."""
    samples = values[None].astype(np.float64)
    mean: Array = cv2.blur(samples, (AVERAGE, 1), borderType=cv2.BORDER_REPLICATE)[0]
    return mean


HAND_DEPTH = 0.015  # m around the hand's front in which its side may be visible
TANGENT_STEP = 0.01  # m between two points that show a direction in the image
FEWEST_POINTS = 8  # of the lifted midline, from which it is a profile
# m, measured minus true: what blur and shadow leave, the mean over ten strips and their
# triangular folds on the twin (`python -m tests.lab study perception`)
CONTACT_BIAS = 0.0003
FAINT = 0.12  # share of strip that an edge-on strip still shows
SHADOW_HEIGHT = 0.006  # m below which the strip casts a visible shadow
LITTLE = 0.03  # m of lifted strip from which its profile counts
LENGTH_ERROR = 0.015  # m; twice that from the stated length: unbelievable
REACH = 0.02  # m from the gripper where its profile may end
GRIPPER_CLEARANCE = TIP_AHEAD + 0.004  # m that the fingers hide
GAP_OPENING = 0.004  # m from which layers count as apart


class Matte(NamedTuple):
    """Matte of the strip in a `region` of a frame: the fraction of strip in each pixel
    as grey `levels` (h, w), see `kernels.strip_share`, and `smooth` ones.
    """

    levels: Image
    smooth: Image
    region: Region


@dataclass(frozen=True, slots=True)
class LiftedMidline:
    """Midline `points` (n, 2) [m] of the lifted strip from desk contact to gripper, and
    the `confidence` in it, 0 to 1.
    """

    points: Array
    confidence: float


UNSEEN = LiftedMidline(np.empty((0, 2)), confidence=0.0)


class Perception:
    """Measures one strip in the frames of one calibrated camera; has no state between
    frames.
    """

    def __init__(
        self, calibration: Calibration, strip: StripFile, appearance: Appearance
    ) -> None:
        self._calibration = calibration
        self._strip = strip
        self._scene = appearance.scene
        self._faint = max(FAINT, 2.0 * appearance.scene.noise)
        self._line = SearchLine.under(strip, calibration, appearance)
        self._zone = strip_zone(calibration, strip.length)
        self._above_shadow = strip_zone(calibration, strip.length, SHADOW_HEIGHT)
        self._sizes = Sizes.of_camera(calibration)
        self._rest = appearance.rest_height
        self._contact_bias = CONTACT_BIAS + calibration.contact_bias

    def measure(
        self, frame: Frame, gripper: Pose, hand: Pose | None = None
    ) -> StripMeasurement:
        """Measure the strip in `frame`; `gripper` is the measured pose at the frame's
        stamp.

        A strip that was let go ends at `gripper`, with the `hand` elsewhere.
        Never raises because of an image: what is not seen is NaN with confidence 0.
        """
        matte = self._matte(frame, gripper, hand or gripper)
        contact = find_contact(matte.smooth, self._line, matte.region.origin)
        curve = self._curve(matte, contact, gripper)
        tip, gap = self._fold(contact, curve)
        return StripMeasurement(
            stamp=frame.stamp,
            sequence=frame.sequence,
            contact_x=contact.x - self._contact_bias,
            contact_confidence=contact.confidence,
            profile=curve.points,
            profile_confidence=curve.confidence,
            tip=tip,
            gap=gap.height if gap else nan,
            gap_x=gap.x if gap else nan,
            gripper=(gripper.x, gripper.z),
        )

    def outline(self, frame: Frame, gripper: Pose) -> Array:
        """Outline (n, 2) [px] of the largest piece of strip in `frame`, held at
        `gripper` or laid.

        Layers that lie on one another are one piece. Empty where no strip is seen.
        """
        matte = self._matte(frame, gripper, gripper, around=HAND_DEPTH)
        outlines, _ = cv2.findContours(
            self._mask(matte), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        largest = max(outlines, key=cv2.contourArea, default=np.empty((0, 1, 2)))
        return largest.reshape(-1, 2) + matte.region.origin

    def _matte(
        self, frame: Frame, gripper: Pose, hand: Pose, around: float = 0.0
    ) -> Matte:
        """Matte of the strip in `frame` where it can appear, leaving out the `hand` and
        `around` [m] beside it.
        """
        region = strip_region(self._calibration, self._strip.length, gripper)
        visible = without_hand(region, self._calibration, hand)
        if around > 0:
            side = 2 * round(around / self._sizes.scale) + 1
            visible = cv2.erode(visible, np.ones((side, side), np.uint8))
        levels, region = self._scene.levels(frame.image, region, visible)
        return Matte(levels, smooth_matte(levels), region)

    def _mask(self, matte: Matte) -> Image:
        """Mask (h, w) of the strip in the region of `matte`, 255 inside."""
        zone = matte.region.crop(self._zone)
        above_shadow = matte.region.crop(self._above_shadow)
        return silhouette(
            levels=matte.smooth,
            faint=self._faint,
            strip=zone,
            lifted=above_shadow,
            length=self._sizes.hanging,
        )

    def _curve(
        self, matte: Matte, contact: DeskContact, gripper: Pose
    ) -> LiftedMidline:
        """Midline of the lifted strip, from its `contact` with the desk to the
        gripper.
        """
        if not np.isfinite(contact.x):
            return UNSEEN
        if np.hypot(gripper.x - contact.x, gripper.z) < LITTLE:
            return LiftedMidline(np.empty((0, 2)), contact.confidence)

        start, grip = self._side_ends(contact, gripper, matte.region)
        mask = self._mask(matte)
        side = outer_side(mask, start, grip, self._sizes)
        if side is None:
            return UNSEEN

        geometry = Geometry(
            calibration=self._calibration,
            thickness=self._strip.thickness,
            width=self._strip.width,
            origin=matte.region.origin,
            sizes=self._sizes,
        )
        seen = midline_points(matte.levels, side, geometry)
        first_lifted = (
            int(np.argmax(seen.points[:, 0] >= contact.x)) if len(seen.points) else 0
        )
        lifted = seen.points[first_lifted:]
        if len(lifted) < FEWEST_POINTS:
            return UNSEEN

        midline = resample(lifted)
        return LiftedMidline(
            midline, self._plausibility(midline, contact, gripper) * seen.visible
        )

    def _plausibility(
        self, midline: Array, contact: DeskContact, gripper: Pose
    ) -> float:
        """Confidence, 0 to 1, in a `midline` (n, 2) [m] by its length and its end at
        the gripper.

        It is 1 up to an error of LENGTH_ERROR, and 0 from twice that on.
        """
        missing = lengths(midline[-1] - (gripper.x, gripper.z))
        length = contact.x + arc_lengths(midline)[-1] + missing
        error = max(abs(length - self._strip.length), missing - REACH)
        return float(np.clip(2 - error / LENGTH_ERROR, 0.0, 1.0))

    def _fold(
        self, contact: DeskContact, curve: LiftedMidline
    ) -> tuple[tuple[float, float], LayerGap | None]:
        """Rightmost point [m] of the fold, NaN without a profile, and the gap of its
        layers.
        """
        if len(curve.points) == 0:
            return (nan, nan), None
        x = np.arange(0.0, max(contact.x, 0.0), SPACING)
        midline = np.vstack([np.column_stack([x, self._rest(x)]), curve.points])
        gap = layer_gap(midline, arc_lengths(midline), GAP_OPENING)
        return fold_tip(midline), gap

    def _side_ends(
        self, contact: DeskContact, gripper: Pose, region: Region
    ) -> tuple[Array, FingerZone]:
        """Ends of the strip's outer outline in the image window: the pixel (2,) of the
        desk contact, and the zone of the fingers.
        """
        tangent = np.array([np.cos(gripper.pitch), np.sin(gripper.pitch)])
        edge = self._outer_edge(gripper, tangent)
        plane = np.array([(contact.x, 0.0), edge, edge + TANGENT_STEP * tangent])
        start, point, behind = self._calibration.to_image(plane) - region.origin
        direction = (behind - point) / lengths(behind - point)
        clearance = GRIPPER_CLEARANCE / self._sizes.scale
        return start, FingerZone(
            point=point,
            approach=direction,
            clearance=clearance,
            aside=self._sizes.aside,
        )

    def _outer_edge(self, gripper: Pose, tangent: Array) -> Array:
        """Point (2,) [m] at the gripper on the strip edge, near or far, that bounds its
        outer side.

        It is the far edge where the strip, of direction `tangent` (2,), turns its face
        to the camera.
        """
        edge = np.array([gripper.x, gripper.z])
        view = self._calibration.viewpoint
        normal = np.array([tangent[1], -tangent[0]])
        if (edge - view.foot()) @ normal < 0:
            edge += view.sweep(self._strip.width) * (view.foot() - edge)
        return edge
