"""Residuals of a fold: measured minus simulated, by sample, with the rig's measurement errors."""

from dataclasses import dataclass

import numpy as np

from cell.gap.subject.strip.layout import Layout, Part
from cell.gap.subject.strip.runs import Measured
from cell.gap.subject.strip.simulation import SHAPE_PERIOD, SimulatedMotion
from cell.gap.subject.subject import Residuals
from drivers.strip.curve import group_means, signed_distances
from drivers.strip.model import StripModel
from drivers.strip.observation import (
    reported_force,
    seen_contact,
    seen_time,
    seen_touch,
    shown_time,
    true_points,
)
from drivers.strip.shape import Touch
from drivers.types import Array

CONTACT_LIMIT = 1.0  # bending lengths between contacts beyond which the strip lies down elsewhere


@dataclass(frozen=True, slots=True)
class Comparison:
    """Compares a run's samples with simulations; `length` and stated `bending_length` in [m]."""

    run: Measured
    layout: Layout
    length: float
    bending_length: float

    def __call__(self, model: StripModel, shown: SimulatedMotion | None) -> Residuals:
        """Residuals of the motion `shown`, as `model` measures it; NaN without a motion."""
        if shown is None:
            lost = np.full(len(self.layout.samples), np.nan)
            return Residuals(lost, lost.copy())
        channels = [
            average(self._profile(model, shown), self.layout.profile),
            self._same_contact(*average(self._contact(model, shown), self.layout.contact)),
            *(average(self._force(model, shown, axis), self.layout.force[axis]) for axis in (0, 1)),
            self._touch(model, shown),
        ]
        mean, square = (np.concatenate(rows) for rows in zip(*channels, strict=True))
        return Residuals(mean, square)

    def _profile(self, model: StripModel, shown: SimulatedMotion) -> Array:
        """Signed distances (n,) of the compared points, in the order of the samples."""
        images, order = self.run.images, self.layout.profile.order
        found = np.empty(len(order))
        if len(order):
            time = np.asarray(shown_time(model.observation, images.stamps))
            points = true_points(model, images.points[order])
            signed_distances(
                np.ascontiguousarray(points),
                images.image[order],
                images.s[order],
                (time - shown.begin) / SHAPE_PERIOD,
                shown.shapes,
                shown.arc * self.length,
                found,
            )
        return found

    def _contact(self, model: StripModel, shown: SimulatedMotion) -> Array:
        order = self.layout.contact.order
        time = shown_time(model.observation, self.run.contact_t[order])
        simulated = np.interp(time, shown.t, shown.contact_x)
        return np.asarray(self.run.contact_x[order] - seen_contact(model.observation, simulated))

    def _same_contact(self, mean: Array, square: Array) -> tuple[Array, Array]:
        """Mask of samples with measured and simulated contact at the same place."""
        here = np.abs(mean) < CONTACT_LIMIT * self.bending_length
        return np.where(here, mean, np.nan), np.where(here, square, np.nan)

    def _force(self, model: StripModel, shown: SimulatedMotion, axis: int) -> Array:
        order = self.layout.force[axis].order
        if not len(order):
            return np.empty(0)
        t = self.run.force_t[order]
        simulated = reported_force(model.observation, t, shown.t, shown.force)
        return np.asarray((self.run.force[order] - simulated)[:, axis])

    def _touch(self, model: StripModel, shown: SimulatedMotion) -> tuple[Array, Array]:
        """Time, mean distance to both edges, displacement (3,), if the run has a touch."""
        if self.run.touch is None:
            return np.empty(0), np.empty(0)
        if shown.touch is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        grip = np.array([np.interp(shown.touch.time, shown.t, c) for c in shown.poses.T])
        stamp = seen_time(model.observation, shown.touch.time)
        reported = np.array([np.interp(stamp, self.run.t, c) for c in self.run.poses.T])
        seen = seen_touch(model, shown.touch, grip, reported)
        mean = _touch_values(self.run.touch) - _touch_values(seen)
        return mean, mean**2


def _touch_values(touch: Touch) -> Array:
    middle = 0.5 * (touch.to_grasped + touch.to_fixed)
    return np.array([touch.time, middle, touch.displacement])


def average(values: Array, part: Part) -> tuple[Array, Array]:
    """Mean and mean square (k,) of each sample's readings, outliers clipped."""
    mean, square = np.empty(len(part)), np.empty(len(part))
    if len(part):
        group_means(np.ascontiguousarray(values), part.edges, part.sigma, mean, square)
    return mean, square
