"""Residuals of a fold: measured minus simulated samples, with the rig's measurement
errors.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.strip.layout import Layout, Part
from cell.gap.subject.strip.midline_residuals import (
    group_means,
    nearest_ends,
    signed_distances,
)
from cell.gap.subject.strip.runs import MeasuredRun
from cell.gap.subject.strip.simulation import SimulatedMotion
from cell.gap.subject.subject import Residuals
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array
from drivers.strip.engine import StripMotion, Touch
from drivers.strip.model import StripModel
from drivers.strip.observation import (
    image_stamp,
    imaged_time,
    measured_contact,
    measured_touch,
    reported_force,
    true_points,
)
from drivers.strip.rod.engine import GripperPath

CONTACT_LIMIT = 1.0  # bending lengths between contacts that are still one and the same


@dataclass(frozen=True, slots=True, eq=False)
class FoldResiduals:
    """Computes the residuals of one measured fold, measured minus simulated motion.

    `length` and stated `bending_length` [m] are the strip's.
    """

    run: MeasuredRun
    layout: Layout
    length: float
    bending_length: float

    def __call__(self, model: StripModel, motion: SimulatedMotion | None) -> Residuals:
        """Residuals against the simulated `motion` of `model`; NaN where the motion is
        None.
        """
        if motion is None:
            lost = np.full(len(self.layout.samples), np.nan)
            return Residuals(lost, lost.copy())
        profile, force = self.layout.profile, self._force_residuals(model, motion)
        channels = [
            average(self.distances(model, motion, profile.order), profile),
            self._contact_averages(model, motion),
            *(
                average(force[p.order, axis], p)
                for axis, p in enumerate(self.layout.force)
            ),
            self._touch_residuals(model, motion),
        ]
        mean, square = (np.concatenate(rows) for rows in zip(*channels, strict=True))
        return Residuals(mean, square)

    def shape_index(self, model: StripModel, motion: SimulatedMotion) -> Array:
        """Fractional index (m,) into the simulated shapes for each image of the run."""
        stamps = self.run.images.stamps
        return motion.index_at(np.asarray(imaged_time(model.observation, stamps)))

    def distances(
        self, model: StripModel, motion: SimulatedMotion, points: NDArray[np.int64]
    ) -> Array:
        """Distances (n,) [m] of measured `points` from the simulated midline, positive
        left of it.

        `points` (n,) are their indices.
        """
        images = self.run.images
        distances = np.empty(len(points))
        if len(points):
            places = np.ascontiguousarray(true_points(model, images.points[points]))
            signed_distances(
                places,
                images.image[points],
                images.s[points],
                self.shape_index(model, motion),
                motion.shapes,
                motion.arc * self.length,
                distances,
            )
        return distances

    def _contact_averages(
        self, model: StripModel, motion: SimulatedMotion
    ) -> tuple[Array, Array]:
        """Mean [m] and mean square [m^2] (k,) of contact residuals, NaN for two
        contacts.

        A strip with a hump, as over a crease, leaves the desk there and at the fold;
        which of them an image shows depends on the hump's height. So a contact far from
        the simulated one is compared with the nearest place where the simulated strip
        leaves the desk.
        """
        limit = CONTACT_LIMIT * self.bending_length
        measured = self.run.contact_x[self.layout.contact.order]
        observation = model.observation
        time = np.asarray(
            imaged_time(observation, self.run.contact_t[self.layout.contact.order])
        )
        simulated = np.interp(time, motion.t, motion.contact_x)
        residuals = np.asarray(measured - measured_contact(observation, simulated))
        far = np.abs(residuals) >= limit
        ends = simulated[far]
        nearest_ends(
            ends + residuals[far],
            motion.index_at(time[far]),
            motion.shapes,
            self.run.contact_height,
            ends,
        )
        residuals[far] = measured[far] - measured_contact(observation, ends)
        mean, square = average(residuals, self.layout.contact)
        near = np.abs(mean) < limit
        return np.where(near, mean, np.nan), np.where(near, square, np.nan)

    def _force_residuals(self, model: StripModel, motion: SimulatedMotion) -> Array:
        """Measured minus simulated force (f, 2) [N] along x and z, NaN where not
        measured.
        """
        t = self.run.force_t
        return self.run.force - reported_force(
            model.observation, t, motion.t, motion.force
        )

    def _touch_residuals(
        self, model: StripModel, motion: SimulatedMotion
    ) -> tuple[Array, Array]:
        """Residuals (3,) [s, m, m] of the touch and their squares, NaN where none is
        simulated.

        Both are empty (0,) where the run measured no touch.
        """
        if self.run.touch is None:
            return np.empty(0), np.empty(0)
        simulated = simulated_touch(self.run, model, motion)
        if simulated is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        mean = _touch_values(self.run.touch) - _touch_values(simulated)
        return mean, mean**2


def simulated_touch(
    path: MeasuredRun | GripperPath,
    model: StripModel,
    motion: SimulatedMotion | StripMotion,
) -> Touch | None:
    """Simulated touch of the layers as images would show it; None if there is none.

    Along the reported `path` the gripper moves; `motion` is the true one.
    """
    if motion.touch is None:
        return None
    grip = interpolate_columns(motion.touch.time, motion.t, motion.poses)
    stamp = image_stamp(model.observation, motion.touch.time)
    reported = interpolate_columns(stamp, path.t, path.poses)
    return measured_touch(model, motion.touch, grip, reported)


def _touch_values(touch: Touch) -> Array:
    """Time [s], mean distance [m] to both edges, and displacement [m] of a touch,
    (3,).
    """
    distance = 0.5 * (touch.to_grasped + touch.to_fixed)
    return np.array([touch.time, distance, touch.displacement])


def average(values: Array, part: Part) -> tuple[Array, Array]:
    """Mean and mean square (k,), in SI, of the readings (n,) of each sample, outliers
    clipped.
    """
    mean, square = np.empty(len(part)), np.empty(len(part))
    if len(part):
        group_means(np.ascontiguousarray(values), part.edges, part.sigma, mean, square)
    return mean, square
