"""A fold as it was measured, and as the rod has it, at the stamps of the images."""

import numpy as np

from cell.gap.drawing import Curve, Scene, Signal, Track
from cell.gap.strip.prepare import Fold
from cell.gap.strip.runs import Measured
from cell.gap.strip.simulation import SHAPES, Shown
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

CONTACT, DISTANCE = "contact [mm]", "distance from the measured midline, rms [mm]"


def measured_scene(run: Measured) -> Scene:
    """What was measured of a fold."""
    images, t = run.images, run.t[::10]
    points = tuple(images.points[images.image == k] for k in range(len(images.stamps)))
    grip = np.stack([np.interp(t, run.t, run.poses[:, c]) for c in range(2)], axis=1)
    return Scene(
        signals=(Signal(CONTACT, run.contact_t, 1e3 * run.contact_x),),
        curve=Curve(images.stamps, points),
        tracks={"contact": _on_desk(run.contact_t, run.contact_x), "gripper": Track(t, grip)},
        events=_told(run.touch),
    )


def simulated_scene(fold: Fold, model: StripModel, shown: Shown, length: float) -> Scene:
    """The same fold of a strip of `length` [m] as `model` has it, seen by the rig's camera."""
    run = fold.comparison.run
    contact = np.interp(shown_time(model.observation, run.contact_t), shown.t, shown.contact_x)
    seen = np.asarray(seen_contact(model.observation, contact))
    stamps, place = run.images.stamps, _places(run, model, shown)
    first = np.minimum(place.astype(np.int64), max(len(shown.shapes) - 2, 0))
    share = (place - first)[:, None, None]
    after = np.minimum(first + 1, len(shown.shapes) - 1)
    shapes = (1 - share) * shown.shapes[first] + share * shown.shapes[after]
    return Scene(
        signals=(
            Signal(CONTACT, run.contact_t, 1e3 * seen),
            Signal(DISTANCE, stamps, 1e3 * _distances(run, model, shown, length)),
        ),
        curve=Curve(stamps, tuple(seen_points(model, shapes))),
        tracks={"contact": _on_desk(run.contact_t, seen)},
        events=_told(_touch(run, model, shown)),
    )


def _places(run: Measured, model: StripModel, shown: Shown) -> Array:
    """Of each image (m,), where in the row of shapes its moment lies; the last one is held."""
    true = np.asarray(shown_time(model.observation, run.images.stamps))
    return np.clip((true - shown.begin) / SHAPES, 0.0, len(shown.shapes) - 1.0)


def _distances(run: Measured, model: StripModel, shown: Shown, length: float) -> Array:
    """Root mean square distance (m,) [m] of each image's points from the simulated midline."""
    images = run.images
    if not len(images.stamps):
        return np.empty(0)
    found = np.empty(len(images.points))
    signed_distances(
        np.ascontiguousarray(true_points(model, images.points)), images.image, images.s,
        _places(run, model, shown), shown.shapes, shown.arc * length, found,
    )  # fmt: skip
    square = np.bincount(images.image, found**2, len(images.stamps))
    return np.asarray(np.sqrt(square / np.bincount(images.image, minlength=len(images.stamps))))


def _on_desk(t: Array, x: Array) -> Track:
    return Track(t, np.stack([x, np.zeros_like(x)], axis=1))


def _touch(run: Measured, model: StripModel, shown: Shown) -> Touch | None:
    """The simulated touch as images would show it."""
    if shown.touch is None:
        return None
    grip = np.array([np.interp(shown.touch.time, shown.t, c) for c in shown.poses.T])
    stamp = seen_time(model.observation, shown.touch.time)
    reported = np.array([np.interp(stamp, run.t, c) for c in run.poses.T])
    return seen_touch(model, shown.touch, grip, reported)


def _told(touch: Touch | None) -> tuple[tuple[float, str], ...]:
    if touch is None:
        return ()
    return ((touch.time, f"layer_touch, displacement {1e3 * touch.displacement:.1f} mm"),)
