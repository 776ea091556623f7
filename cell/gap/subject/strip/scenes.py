"""Draws a fold as measured and as simulated by the rod, at the stamps of the images."""

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.scene import Curve, Scene, Signal, Track
from cell.gap.subject.strip.prepare import Fold
from cell.gap.subject.strip.runs import Measured
from cell.gap.subject.strip.simulation import SHAPE_PERIOD, SimulatedMotion
from drivers.strip.curve import signed_distances
from drivers.strip.model import StripModel
from drivers.strip.observation import (
    seen_contact,
    seen_points,
    seen_time,
    seen_touch,
    shown_time,
    true_points,
)
from drivers.strip.shape import Touch
from drivers.types import Array

Index = NDArray[np.int64]
CONTACT_SIGNAL, DISTANCE_SIGNAL = "contact [mm]", "distance from the measured midline, rms [mm]"


def measured_scene(run: Measured) -> Scene:
    """Drawing of a measured fold until its layers touched, or its last row."""
    images, t = run.images, run.t[run.t <= run.end][::10]
    grip = np.stack([np.interp(t, run.t, run.poses[:, c]) for c in range(2)], axis=1)
    shown, seen = _images_before_end(run), run.contact_t <= run.end
    contact_t, contact = run.contact_t[seen], run.contact_x[seen]
    points = tuple(images.points[images.image == k] for k in shown)
    return Scene(
        signals=(Signal(CONTACT_SIGNAL, contact_t, 1e3 * contact),),
        curve=Curve(images.stamps[shown], points),
        tracks={"contact": _desk_track(contact_t, contact), "gripper": Track(t, grip)},
        events=_touch_event(run.touch),
    )


def simulated_scene(fold: Fold, model: StripModel, shown: SimulatedMotion, length: float) -> Scene:
    """Drawing of the same fold, of a strip of `length` [m], as `model` simulates it.

    Distances are of the images that are compared: not of the first of the lift, nor of the snap.
    """
    run = fold.comparison.run
    contact_t = run.contact_t[run.contact_t <= run.end]
    true = np.interp(shown_time(model.observation, contact_t), shown.t, shown.contact_x)
    contact = np.asarray(seen_contact(model.observation, true))
    images = _images_before_end(run)
    shapes = _interpolate_shapes(_shape_indices(run, model, shown)[images], shown)
    compared, distance = _distances(fold, model, shown, length)
    return Scene(
        signals=(
            Signal(CONTACT_SIGNAL, contact_t, 1e3 * contact),
            Signal(DISTANCE_SIGNAL, run.images.stamps[compared], 1e3 * distance),
        ),
        curve=Curve(run.images.stamps[images], tuple(seen_points(model, shapes))),
        tracks={"contact": _desk_track(contact_t, contact)},
        events=_touch_event(_touch(run, model, shown)),
    )


def _images_before_end(run: Measured) -> Index:
    """Numbers of the images before the end of the run."""
    return np.flatnonzero(run.images.stamps <= run.end)


def _shape_indices(run: Measured, model: StripModel, shown: SimulatedMotion) -> Array:
    """Fractional indices (m,) into the row of shapes for the images; the last shape is held."""
    true = np.asarray(shown_time(model.observation, run.images.stamps))
    return np.clip((true - shown.begin) / SHAPE_PERIOD, 0.0, len(shown.shapes) - 1.0)


def _interpolate_shapes(places: Array, shown: SimulatedMotion) -> Array:
    """Shapes (m, nodes, 2) interpolated between the stored ones."""
    first = places.astype(np.int64)
    after = np.minimum(first + 1, len(shown.shapes) - 1)
    share = (places - first)[:, None, None]
    return np.asarray((1 - share) * shown.shapes[first] + share * shown.shapes[after])


def _distances(
    fold: Fold, model: StripModel, shown: SimulatedMotion, length: float
) -> tuple[Index, Array]:
    """Indices of compared images, and rms distances (k,) [m] of their points from the model."""
    run = fold.comparison.run
    images, order = run.images, np.sort(fold.comparison.layout.profile.order)
    found = np.empty(len(order))
    if len(order):
        points = true_points(model, images.points[order])
        signed_distances(
            np.ascontiguousarray(points), images.image[order], images.s[order],
            _shape_indices(run, model, shown), shown.shapes, shown.arc * length, found,
        )  # fmt: skip
    compared, image = np.unique(images.image[order], return_inverse=True)
    return compared, np.sqrt(np.bincount(image, found**2) / np.bincount(image))


def _desk_track(t: Array, x: Array) -> Track:
    return Track(t, np.stack([x, np.zeros_like(x)], axis=1))


def _touch(run: Measured, model: StripModel, shown: SimulatedMotion) -> Touch | None:
    """The simulated touch as images would show it."""
    if shown.touch is None:
        return None
    grip = np.array([np.interp(shown.touch.time, shown.t, c) for c in shown.poses.T])
    stamp = seen_time(model.observation, shown.touch.time)
    reported = np.array([np.interp(stamp, run.t, c) for c in run.poses.T])
    return seen_touch(model, shown.touch, grip, reported)


def _touch_event(touch: Touch | None) -> tuple[tuple[float, str], ...]:
    if touch is None:
        return ()
    return ((touch.time, f"layer_touch, displacement {1e3 * touch.displacement:.1f} mm"),)
