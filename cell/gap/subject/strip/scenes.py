"""Draws a fold as measured and as simulated, at the times of its images."""

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.strip.fold_residuals import simulated_touch
from cell.gap.subject.strip.midline_residuals import interpolate_midlines
from cell.gap.subject.strip.prepare import PreparedFold
from cell.gap.subject.strip.runs import MeasuredRun
from cell.gap.subject.strip.simulation import SimulatedMotion
from cell.gap.subject.subject import Curve, Scene, TimeSeries, Track
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array
from drivers.strip.engine import Touch
from drivers.strip.model import StripModel
from drivers.strip.observation import imaged_time, measured_contact, measured_points

Index = NDArray[np.int64]
DRAWN_STRIDE = 10  # rows of a run between drawn places of the gripper
CONTACT_SIGNAL, DISTANCE_SIGNAL = (
    "contact [mm]",
    "distance from the measured midline, rms [mm]",
)


def measured_scene(run: MeasuredRun) -> Scene:
    """Drawing of a measured fold, up to the touch of its layers or to its last row."""
    images, t = run.images, run.t[run.t <= run.end][::DRAWN_STRIDE]
    grip = interpolate_columns(t, run.t, run.poses[:, :2])
    visible = _images_before_end(run)
    before_end = run.contact_t <= run.end
    contact_t = run.contact_t[before_end]
    contact = run.contact_x[before_end]
    points = tuple(images.points[images.image == k] for k in visible)
    return Scene(
        signals=(TimeSeries(CONTACT_SIGNAL, contact_t, 1e3 * contact),),
        curve=Curve(images.stamps[visible], points),
        tracks={"contact": _desk_track(contact_t, contact), "gripper": Track(t, grip)},
        events=_touch_event(run.touch),
    )


def simulated_scene(
    fold: PreparedFold, model: StripModel, motion: SimulatedMotion
) -> Scene:
    """Drawing of `fold` as simulated with `model`.

    Distances are of the images that are compared: not those of the first lift and of
    the snap.
    """
    run = fold.residuals.run
    contact_t = run.contact_t[run.contact_t <= run.end]
    true = np.interp(
        imaged_time(model.observation, contact_t), motion.t, motion.contact_x
    )
    contact = np.asarray(measured_contact(model.observation, true))
    images = _images_before_end(run)
    places = fold.residuals.shape_index(model, motion)[images]
    shapes = interpolate_midlines(motion.shapes, places)
    compared, distance = _distances(fold, model, motion)
    return Scene(
        signals=(
            TimeSeries(CONTACT_SIGNAL, contact_t, 1e3 * contact),
            TimeSeries(DISTANCE_SIGNAL, run.images.stamps[compared], 1e3 * distance),
        ),
        curve=Curve(run.images.stamps[images], tuple(measured_points(model, shapes))),
        tracks={"contact": _desk_track(contact_t, contact)},
        events=_touch_event(simulated_touch(run, model, motion)),
    )


def _images_before_end(run: MeasuredRun) -> Index:
    """Indices (m,) of the images before the end of the run."""
    return np.flatnonzero(run.images.stamps <= run.end)


def _distances(
    fold: PreparedFold, model: StripModel, motion: SimulatedMotion
) -> tuple[Index, Array]:
    """Indices of compared images, and rms distances (k,) [m] of their points from the
    model.
    """
    order = np.sort(fold.residuals.layout.profile.order)
    distances = fold.residuals.distances(model, motion, order)
    compared, image = np.unique(
        fold.residuals.run.images.image[order], return_inverse=True
    )
    return compared, np.sqrt(np.bincount(image, distances**2) / np.bincount(image))


def _desk_track(t: Array, x: Array) -> Track:
    """Track of a point on the desk at `x` (m,) [m] at the times `t` (m,) [s]."""
    return Track(t, np.stack([x, np.zeros_like(x)], axis=1))


def _touch_event(touch: Touch | None) -> tuple[tuple[float, str], ...]:
    """Pair of time [s] and text of the `touch`, with its displacement; empty without a
    touch.
    """
    if touch is None:
        return ()
    return (
        (touch.time, f"layer_touch, displacement {1e3 * touch.displacement:.1f} mm"),
    )
