"""Measurement of one strip in camera frames: desk contact, profile, fold tip, gap of
layers.
"""

from dataclasses import dataclass
from math import nan
from typing import NamedTuple

import cv2
import numpy as np

from calibration.calibration import Calibration
from cell.perception.contact import Contact, SearchLine, find_contact
from cell.perception.kernels import smooth_matte
from cell.perception.profile import SPACING, Geometry, midline_points, resample
from cell.perception.region import (
    Region,
    Sizes,
    strip_region,
    strip_zone,
    without_hand,
)
from cell.perception.scene import Appearance
from cell.perception.silhouette import Grip, outer_side, silhouette
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.geometry import arc_lengths
from drivers.base.types import Array, Frame, Image, Pose
from drivers.franka.shapes import TIP_AHEAD
from drivers.strip.file import StripFile
from drivers.strip.shape import Gap, fold_tip, layer_gap

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
    """Matte of the strip in a `region` of a frame: `levels` (h, w), and their `smooth`
    version.

    Grey levels are of the strip's share in a pixel, see `kernels.strip_share`.
    """

    levels: Image
    smooth: Image
    region: Region


@dataclass(frozen=True, slots=True)
class Curve:
    """Midline `points` (n, 2) [m] of the lifted strip, contact to gripper, and its
    `confidence`.
    """

    points: Array
    confidence: float


UNSEEN = Curve(np.empty((0, 2)), 0.0)


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
        """Matte of `frame` where the strip can appear, without the `hand` and `around`
        [m] of it.
        """
        region = strip_region(self._calibration, self._strip.length, gripper)
        visible = without_hand(region, self._calibration, hand)
        if around > 0:
            side = 2 * round(around / self._sizes.scale) + 1
            visible = cv2.erode(visible, np.ones((side, side), np.uint8))
        levels, region = self._scene.levels(frame.image, region, visible)
        return Matte(levels, smooth_matte(levels), region)

    def _mask(self, matte: Matte) -> Image:
        """Mask (h, w) of the strip in the matte's region, 255 inside."""
        zone = matte.region.crop(self._zone)
        above_shadow = matte.region.crop(self._above_shadow)
        return silhouette(
            matte.smooth, self._faint, zone, above_shadow, self._sizes.hanging
        )

    def _curve(self, matte: Matte, contact: Contact, gripper: Pose) -> Curve:
        """Midline of the lifted strip, from its `contact` with the desk to the
        gripper.
        """
        if not np.isfinite(contact.x):
            return UNSEEN
        if np.hypot(gripper.x - contact.x, gripper.z) < LITTLE:
            return Curve(np.empty((0, 2)), contact.confidence)
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
        return Curve(
            midline, self._plausibility(midline, contact, gripper) * seen.visible
        )

    def _plausibility(self, midline: Array, contact: Contact, gripper: Pose) -> float:
        """Confidence, 0 to 1, in a `midline` (n, 2) [m] by its length and its end at
        the gripper.

        It is 1 up to an error of LENGTH_ERROR, and 0 from twice that on.
        """
        missing = float(np.hypot(*(midline[-1] - (gripper.x, gripper.z))))
        length = contact.x + arc_lengths(midline)[-1] + missing
        error = max(abs(length - self._strip.length), missing - REACH)
        return float(np.clip(2 - error / LENGTH_ERROR, 0.0, 1.0))

    def _fold(
        self, contact: Contact, curve: Curve
    ) -> tuple[tuple[float, float], Gap | None]:
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
        self, contact: Contact, gripper: Pose, region: Region
    ) -> tuple[Array, Grip]:
        """Ends of the strip's outer outline in the window: pixel (2,) of the contact,
        and grip.
        """
        tangent = np.array([np.cos(gripper.pitch), np.sin(gripper.pitch)])
        edge = self._outer_edge(gripper, tangent)
        plane = np.array([(contact.x, 0.0), edge, edge + TANGENT_STEP * tangent])
        start, point, behind = self._calibration.to_image(plane) - region.origin
        direction = (behind - point) / np.hypot(*(behind - point))
        clearance = GRIPPER_CLEARANCE / self._sizes.scale
        return start, Grip(point, direction, clearance, self._sizes.aside)

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
