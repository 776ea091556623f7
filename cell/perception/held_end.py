"""Tracking of a strip's held end in images alone, for films without the poses of an
arm.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import hypot, nan
from typing import Self

import cv2
import numpy as np
from numpy.polynomial import polynomial

from calibration.calibration import Calibration
from cell.perception.perception import Perception
from cell.perception.resting_strip import sample_plane, sample_rectangle, sample_scene
from cell.perception.scene import Appearance, colour_distances
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.geometry import (
    arc_lengths,
    interpolate_columns,
    left_normals,
    rotation,
    unit,
)
from drivers.base.types import Array, Frame, Image, Pose
from drivers.strip.file import StripFile

PROFILE_CONFIDENCE = 0.5  # confidence in a profile from which the end is taken from it
CLOSE = 0.001  # m, change of the end below which the iteration has converged
ROUNDS, DAMPED = 6, 0.5  # of the iteration, and share of its further steps
END_LENGTH = 0.04  # m at the profile's end from which it is extrapolated
MOST_STEPS = 5.0  # times the last motion of the end, by which it is extrapolated
UPRIGHT_HEIGHT = 0.1  # m of lift after which the end hangs upright
LIFTS = (0.03, 0.045, 0.06, 0.08)  # m, heights at which a newly lifted end is searched
# m along and above the strip's end: pixels of the clip
FACE = ((0.004, 0.011), (0.0, 0.003))
# standard deviations: colour distance up to which a pixel belongs to the clip
ALIKE = 4.0
# standard deviations of a clip's colour from those of strip and desk, at least
APART = 8.0
FRONT = 0.05  # quantile of the face along its axis at which its front lies
FARTHEST = 0.02  # m from the strip's end to the clip's front at most
WINDOW = 0.08  # m about the end's last place in which the clip is searched
SMALLEST, LARGEST = 0.3, 3.0  # allowed area of the face over that at rest
SLENDER = 1.5  # length over height of the visible face, at least, for a known axis
FINE = 0.00025  # m between samples along a line on which the strip's end is searched
AROUND = (0.02, 0.03)  # m of that line before and after the end of the profile
ROWS = 5  # of the image in which it is searched
BESIDE = 0.001  # m to either side, where a line may miss a clip's narrow mouth
EDGE_ON = 0.002  # m, apparent width of a strip's face up to which it is seen edge on
SURE = 0.004  # m of foreign colour that end the strip
UNLIKE = 4.0  # standard deviations: colour distance from which a colour is foreign
# m about the expected end, where it is not found
SEARCH_STEPS = (-0.03, -0.015, 0.015, 0.03)


@dataclass(frozen=True, slots=True)
class Face:
    """Visible face of the clip that holds a strip: `area` [px], `front` (2,) [m],
    `axis` [rad].

    The front is where its axis enters it from the strip: fingers hide a part of the
    other end.
    """

    area: float
    front: Array
    axis: float
    slenderness: float

    @classmethod
    def from_points(cls, points: Array, pitch: float) -> Self:
        """Face whose pixels lie at `points` (n, 2) [m], its axis within pi/2 of `pitch`
        [rad].
        """
        middle = points.mean(axis=0)
        variances, axes = np.linalg.eigh(np.cov((points - middle).T))
        axis = axes[:, 1]
        if not axis @ np.array([np.cos(pitch), np.sin(pitch)]) > 0:
            axis = -axis
        front = middle + np.quantile((points - middle) @ axis, FRONT) * axis
        slenderness = np.sqrt(variances[1] / max(variances[0], 1e-12))
        return cls(
            area=float(len(points)),
            front=front,
            axis=float(np.arctan2(axis[1], axis[0])),
            slenderness=slenderness,
        )


@dataclass(frozen=True, slots=True)
class Clip:
    """Visible clip that holds a strip: its `colour` (3,) in BGR, and its `face` as seen
    at rest, relative to the strip's end.
    """

    colour: Array
    face: Face

    @classmethod
    def learn(
        cls, image: Image, calibration: Calibration, strip: StripFile
    ) -> Self | None:
        """Learn the clip at the end of `strip` from `image` (h, w, 3) at rest; None
        without one.
        """
        whole = strip.length
        (begin, stop), height = FACE
        span = (whole + begin, whole + stop)
        colour = np.median(sample_rectangle(image, calibration, span, height), axis=0)
        scene = sample_scene(image, calibration, strip)
        others = np.stack([np.median(scene.strip, axis=0), scene.desk_colour])
        if colour_distances(others, colour[None]).min() < APART:
            return None

        face = _face(image, calibration, colour, Pose(whole, 0.0, 0.0))
        if face is None or face.slenderness < SLENDER:
            return None

        offset = face.front - (whole, 0.0)
        is_at_end = abs(offset[0]) < FARTHEST
        return cls(colour, replace(face, front=offset)) if is_at_end else None

    def find(self, image: Image, calibration: Calibration, last: Pose) -> Pose | None:
        """Pose of the strip's held end from its clip in `image` (h, w, 3), near the
        pose `last`; None where the clip is hidden.
        """
        face = _face(image, calibration, self.colour, last)
        if face is None or not SMALLEST < face.area / self.face.area < LARGEST:
            return None
        pitch = face.axis - self.face.axis
        x, z = (face.front - rotation(pitch) @ self.face.front).tolist()
        return Pose(x, z, pitch)


def _face(
    image: Image, calibration: Calibration, colour: Array, last: Pose
) -> Face | None:
    """Face of a clip: the largest region of its `colour` (3,) in BGR near the end's
    `last` pose; None without one.
    """
    square = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * WINDOW
    corners = calibration.to_image(np.add(square, (last.x, last.z)))
    size = calibration.lens.size
    first = np.clip(corners.min(axis=0), 0, size).astype(int)
    right, bottom = np.clip(corners.max(axis=0), 0, size).astype(int)
    left, top = first
    region = _largest_region(image[top:bottom, left:right], colour)
    if region is None:
        return None
    return Face.from_points(calibration.to_plane(region + first), last.pitch)


def _largest_region(image: Image, colour: Array) -> Array | None:
    """Columns and rows (n, 2) [px] of the largest region of a `colour` (3,) in `image`
    (h, w, 3); None without one.
    """
    if image.size == 0:
        return None

    away = colour_distances(image.astype(np.float64), colour[None])[..., 0]
    alike = (away < ALIKE).astype(np.uint8)
    mask = cv2.morphologyEx(alike, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, labels, pieces, _ = cv2.connectedComponentsWithStats(mask)
    _, *areas = pieces[:, cv2.CC_STAT_AREA]
    if not areas:
        return None

    v, u = np.nonzero(labels == 1 + np.argmax(areas))
    return np.column_stack([u, v]).astype(np.float64)


@dataclass(frozen=True, slots=True)
class HeldMeasurement:
    """Strip measured in one image, and the pose of its held `end`, None where it is
    hidden.
    """

    measurement: StripMeasurement
    end: Pose | None


class HeldEnd:
    """Tracks the pose of a strip's held end from image to image of a film.

    The end is the point at the strip's full length along the extrapolated profile. Its
    place in turn limits where the profile is measured, so both are iterated from the
    expected end. Where a clip that holds the end is visible, the end is in its mouth.
    """

    def __init__(
        self,
        calibration: Calibration,
        strip: StripFile,
        appearance: Appearance,
        clip: Clip | None = None,
    ) -> None:
        self._calibration = calibration
        self._clip = clip
        self._perception = Perception(calibration, strip, appearance)
        self._strip = strip
        # m, from where the clip's face says that the mouth is
        self._to_mouth = np.zeros(2)
        self._past: list[tuple[float, Pose]] = []

    def measure(self, frame: Frame) -> HeldMeasurement:
        """Measure the strip and its held end in `frame`, which is later than all before
        it.
        """
        last = self._past[-1][1] if self._past else Pose(self._strip.length, 0.0, 0.0)
        clip = self._clip
        face = None if clip is None else clip.find(frame.image, self._calibration, last)
        if clip is not None and face is not None:
            best = self._at_mouth(frame, clip, face)
        else:
            best = self._search(frame)

        if best.end is not None:
            self._past = [*self._past[-2:], (frame.stamp, best.end)]

        sure = face is not None or best.measurement.confidence >= PROFILE_CONFIDENCE
        return best if sure else replace(best, end=None)

    def _at_mouth(self, frame: Frame, clip: Clip, face: Pose) -> HeldMeasurement:
        """Measure up to the mouth of the `clip`, near the pose `face` of its visible
        face.

        The clip's depth moves its face by parallax; the mouth is where the strip's near
        edge ends. It stays where it was in the face while the strip is seen edge on,
        and the clip before it.
        """
        at_face = np.array([face.x, face.z])
        x, z = (at_face + self._to_mouth).tolist()
        measurement = self._perception.measure(frame, Pose(x, z, face.pitch))

        view = self._calibration.viewpoint
        normal = np.array([-np.sin(face.pitch), np.cos(face.pitch)])
        over = (view.foot() - at_face) @ normal
        face_width = view.sweep(self._strip.width) * abs(over)
        if len(measurement.profile) > 2 and face_width > EDGE_ON:
            to_mouth = self._mouth(frame, clip, measurement.profile) - at_face
            if np.linalg.norm(to_mouth) < FARTHEST:  # not where it is NaN
                self._to_mouth = to_mouth

        x, z = (at_face + self._to_mouth).tolist()
        end = replace(face, x=x, z=z)
        return HeldMeasurement(replace(measurement, gripper=(x, z)), end)

    def _mouth(self, frame: Frame, clip: Clip, profile: Array) -> Array:
        """Point (2,) x, z [m] at which the strip's near edge ends in the `clip`; NaN
        where none is seen.
        """
        distances = np.arange(-AROUND[0], AROUND[1], FINE)
        line, _ = _extrapolate(profile, distances)
        end = find_end(
            frame.image,
            self._calibration,
            self._strip.thickness,
            line=line.T,
            clip=clip.colour,
        )
        return interpolate_columns(end, distances + AROUND[0], line.T)

    def _search(self, frame: Frame) -> HeldMeasurement:
        """Measure from guesses of the held end's pose, one after another, until the
        confidence in a profile suffices.
        """
        first, *guesses = self._guesses(frame.stamp)
        best = self._iterate(frame, first)
        for guess in guesses:
            if (
                best.end is not None
                and best.measurement.confidence >= PROFILE_CONFIDENCE
            ):
                break
            measured = self._iterate(frame, guess)
            if measured.measurement.confidence > best.measurement.confidence:
                best = measured
        return best

    def _guesses(self, stamp: float) -> Iterator[Pose]:
        """Yield guesses of the held end's pose: extrapolated, last and nearby ones; in
        the first image slightly lifted.
        """
        if not self._past:
            length = self._strip.length
            yield Pose(length, 0.0, 0.0)
            for height in LIFTS:
                pitch = height / UPRIGHT_HEIGHT * np.pi / 2
                yield Pose(length - height / 2, height, pitch)
            return

        last = self._past[-1][1]
        expected = self._predict(stamp)
        yield expected
        yield last

        for step in SEARCH_STEPS:
            yield replace(expected, x=expected.x + step)
            yield replace(expected, z=max(expected.z + step, 0.0))

    def _predict(self, stamp: float) -> Pose:
        """Pose of the held end at `stamp` [s], linearly extrapolated from its last two
        poses.
        """
        past = self._past
        if len(past) < 2:
            return past[-1][1]
        (before, start), (then, last) = past[-2:]
        steps = min((stamp - then) / (then - before), MOST_STEPS)
        ahead = last.as_array() + steps * (last.as_array() - start.as_array())
        x, z, _ = ahead.tolist()
        return Pose(x, max(z, 0.0), last.pitch)

    def _iterate(self, frame: Frame, guess: Pose) -> HeldMeasurement:
        """Measure the strip and its held end by damped fixed-point iteration from
        `guess`; the end is None where that does not converge.

        Fingers hide the strip's end: near the desk full steps swing about it.
        """
        share = 1.0
        for _ in range(ROUNDS):
            measurement = self._perception.measure(frame, guess)
            end = self._end_pose(measurement)
            if end is None:
                break
            place = guess.as_array()
            step = end.as_array() - place
            if hypot(*step[:2]) < CLOSE:
                at = end.x, end.z
                return HeldMeasurement(replace(measurement, gripper=at), end)
            guess = Pose(*(place + share * step).tolist())
            share = DAMPED
        return HeldMeasurement(measurement, end=None)

    def _end_pose(self, measurement: StripMeasurement) -> Pose | None:
        """Pose of the held end: at the strip's full length along its extrapolated
        profile; None without a profile.
        """
        curve = measurement.profile
        if len(curve) < 2:
            return None

        along = measurement.contact_x + arc_lengths(curve)
        within = curve[along <= self._strip.length]
        if len(within) < 2:
            return None

        missing = self._strip.length - along[len(within) - 1]
        point, slope = _extrapolate(within, missing)
        x, z = point.tolist()
        return Pose(x, z, float(np.arctan2(slope[1], slope[0])))


def _extrapolate(curve: Array, distance: float | Array) -> tuple[Array, Array]:
    """Points (2, ...) and slopes (2, ...) at a `distance` (...) [m] beyond a curve (n,
    2) [m].

    By a parabola of its end.
    """
    along = arc_lengths(curve)
    back = along - along[-1]
    last = back >= max(-END_LENGTH, back[0])
    fit = polynomial.polyfit(back[last], curve[last], min(2, last.sum() - 1))
    point = polynomial.polyval(distance, fit)
    slope = polynomial.polyval(distance, polynomial.polyder(fit))
    return np.asarray(point), np.asarray(slope)


def find_end(
    image: Image,
    calibration: Calibration,
    thickness: float,
    line: Array,
    clip: Array | None = None,
) -> float:
    """Distance [m] along a `line` (n, 2) at which the near edge of a strip ends; NaN
    where unseen.

    The line, points FINE apart, begins on the strip's midline and leads on past its
    end, where another colour is, or that of the `clip` (3,). The rows searched show the
    strip's thickness: its face ends elsewhere in the image, the further back the more.
    """
    ahead = np.gradient(line, axis=0)
    aside = unit(left_normals(ahead))
    offsets = np.linspace(-1.0, 1.0, ROWS) * (thickness / 4 if clip is None else BESIDE)
    rows = sample_plane(image, calibration, line + offsets[:, None, None] * aside)
    starts = np.median(rows[:, : len(line) // 4], axis=1)
    edges = np.array(
        [colour_edge(row, start, clip) for row, start in zip(rows, starts, strict=True)]
    )
    seen = edges[np.isfinite(edges)]
    return FINE * float(np.median(seen)) if len(seen) else nan


def colour_edge(row: Array, colour: Array, beyond: Array | None = None) -> float:
    """Index of the sample at which `row` (m, 3) of BGR changes from `colour` (3,) to
    another.

    The other, nearer to `beyond` (3,) where that is given, lasts for SURE; the edge
    lies at half the change. NaN without an edge.
    """
    length = round(SURE / FINE)
    away = colour_distances(row, colour[None])[:, 0]
    foreign = away > UNLIKE
    if beyond is not None:
        foreign &= colour_distances(row, beyond[None])[:, 0] < away

    # the first run of `length` samples of another colour
    start = np.argmin(foreign)  # a row may begin in a shadow
    in_window = np.convolve(foreign[start:], np.ones(length), "valid")
    lasting = np.flatnonzero(in_window == length)
    if foreign[start] or len(lasting) == 0:
        return nan
    end = start + lasting[0] + length

    # half of the way from one colour to the other, between two samples
    change = np.median(row[end - length // 2 : end], axis=0) - colour
    progress = (row[start:end] - colour) @ change / (change @ change)  # from 0 to 1
    last = int(np.max(np.flatnonzero(progress[:-1] < 0.5), initial=0))
    fraction = np.interp(0.5, progress[last : last + 2], (0.0, 1.0))
    return float(start + last + fraction)
