"""Makes measured folds from simulated ones: planned runs, and run folders with
noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from scipy.interpolate import CubicSpline

from cell.gap.subject.strip.fold_residuals import TOUCH_TIME, simulated_touch
from cell.gap.subject.strip.preprocessing import Midlines
from cell.gap.subject.strip.runs import MeasuredRun
from cell.record.documents import write_document
from cell.record.files import PROFILE, RESULT, RUN, TICKS
from cell.record.header import Sigma
from cell.record.tables import place_contacts, write_parquet
from drivers.base.geometry import arc_lengths, interpolate_columns, left_normals, unit
from drivers.base.readers import SCHEMA
from drivers.base.types import Array, frozen
from drivers.strip.describe import describe
from drivers.strip.engine import StripMotion, Touch
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.observation import (
    imaged_time,
    mean_force,
    measured_contact,
    measured_points,
    reported_force,
)
from drivers.strip.rod.engine import GripperPath, Rod, simulate_all
from drivers.strip.rod.lumping import lattice
from drivers.strip.shape import desk_contact
from policies.experiments.motion import Motion
from policies.experiments.standard import STANDARD
from policies.path import lift_pitch
from policies.registry import MOTION

STEP = 0.001  # s
ROW_STRIDE = 10  # steps between the rows that an arm reports
CORNER_TIME = 0.04  # s before and after a corner in which the arm turns its velocity
DWELL_TIME = 0.6  # s at the end of a motion in which the arm stays
TIME_AFTER_TOUCH = 0.3  # s that a run goes on after its touch
HIDDEN_LENGTH = 0.004  # m of the strip before the grip that the fingers hide
SHAPE_INTERVAL = 0.005  # s between the shapes of a motion that are kept
SET_UP = 1.5  # minutes to lay the strip flat again
IMAGE_PERIOD = 0.06  # s between images of a planned run
POINT_SPACING = 0.015  # m between points of such an image
PLAN_SEGMENTS, PLAN_STEP = 100, 0.005  # of the rod: a plan need not be finer
IMAGE_RATE = 30.0  # Hz of the images that are written
MIDLINE_SPACING = 0.006  # m between points of such an image
LOST = 0.02  # usual share of images that are lost
WILD, FARTHEST = 0.005, 0.05  # usual share of points that are off, by up to so many m
BENCH = Sigma(
    contact_x=0.0015,
    profile=0.001,
    gripper=0.00002,
    displacement=0.003,
    touch_time=0.03,
)
"""Measurement noise of a usual cell, which measures no force."""


def reported_path(motion: Motion) -> GripperPath:
    """Gripper path that a robot arm would report for the planned `motion`, which begins
    and ends at rest and has rounded corners.
    """
    t = np.arange(0.0, motion.duration + 2 * CORNER_TIME + DWELL_TIME, STEP)
    half = round(CORNER_TIME / STEP)
    window = np.hanning(2 * half + 3)[1:-1]  # without the zeros at its ends
    points = motion.at(np.clip(t - CORNER_TIME, 0.0, motion.duration))
    held = np.pad(points, [(half, half), (0, 0)], mode="edge")  # at both ends
    smooth = [
        np.convolve(column, window / window.sum(), mode="valid") for column in held.T
    ]
    places = np.stack(smooth, axis=1)
    travel = arc_lengths(places)
    poses = np.column_stack([places, lift_pitch(travel)])
    return GripperPath(frozen(t[::ROW_STRIDE]), frozen(poses[::ROW_STRIDE]))


@dataclass(frozen=True, slots=True)
class Fold:
    """Simulated fold: the reported gripper path, the model of strip and rig, and the
    true motion, with the times of its shapes.

    `shape_t` (m,) [s] are the times of the motion's shapes, `arc` (nodes,) [m] their
    places.
    """

    path: GripperPath
    model: StripModel
    motion: StripMotion
    shape_t: Array
    arc: Array
    index: int = 0
    condition: str = ""


def rod_folds(
    models: Sequence[StripModel],
    paths: Sequence[GripperPath],
    segments: int,
    dt: float,
) -> list[Fold]:
    """Folds of strips simulated as elastic rods, one of each strip model in `models`
    along the gripper path of the same index in `paths`.
    """
    every = max(1, round(SHAPE_INTERVAL / dt))
    motions = simulate_all(Rod(segments), models, paths, dt=dt, every=every)
    return [
        Fold(
            path=path,
            model=model,
            motion=motion,
            shape_t=motion.t[every - 1 :: every][: len(motion.shapes)],
            arc=lattice(model.mechanics.length, segments),
        )
        for path, model, motion in zip(paths, models, motions, strict=True)
    ]


def planned_runs(strip: StripFile, sigma: Sigma, index: int) -> list[MeasuredRun]:
    """Simulated runs of `strip` without noise, one for each standard motion, all with
    the number `index`.
    """
    paths = {
        name: reported_path(motion.over(strip.length))
        for name, motion in STANDARD.items()
    }
    runs = measured_along(paths, strip, sigma, index)
    return [replace(run, condition=MOTION + run.name) for run in runs]


def measured_along(
    paths: Mapping[str, GripperPath], strip: StripFile, sigma: Sigma, index: int
) -> list[MeasuredRun]:
    """Simulated runs of `strip` without noise along each of the gripper `paths`, which
    are given by the name of the run.
    """
    models = [describe(strip, index=index)] * len(paths)
    folds = rod_folds(models, list(paths.values()), PLAN_SEGMENTS, PLAN_STEP)
    return [
        _measure(n, fold, sigma, index) for n, fold in zip(paths, folds, strict=True)
    ]


def _measure(name: str, fold: Fold, sigma: Sigma, index: int) -> MeasuredRun:
    """Run called `name` with the measurements of a simulated fold, without noise, up to
    the touch of its layers.
    """
    path = fold.path
    motion = fold.motion
    times = fold.shape_t
    t = path.t
    touch = motion.touch
    end = touch.time if touch else t[-1]
    height = fold.model.observation.contact_height
    following = np.searchsorted(times, np.arange(times[0], end, IMAGE_PERIOD))
    chosen = np.unique(np.minimum(following, len(times) - 1))
    shapes = motion.shapes[chosen]
    stamps = frozen(times[chosen])
    force_t = t[t <= end] if sigma.force else np.empty(0)
    return MeasuredRun(
        name,
        name,
        t=t,
        poses=path.poses,
        travel=frozen(arc_lengths(path.poses[:, :2])),
        hanging=False,
        index=index,
        contact_height=height,
        sigma=sigma,
        contact_t=stamps,
        contact_x=frozen([desk_contact(shape, height) for shape in shapes]),
        images=_images(stamps, shapes, fold.arc, height),
        force_t=force_t,
        force=_reported_force(fold, force_t),
        touch=touch,
        end=end,
    )


def _images(stamps: Array, shapes: Array, arc: Array, height: float) -> Midlines:
    """Midline points that images of the simulated `shapes` show, each from the point
    where the strip leaves the desk.
    """
    s = np.arange(0.0, arc[-1], POINT_SPACING)
    points = []
    places = []
    for shape in shapes:
        curve = interpolate_columns(s, arc, shape)
        lifted = s >= s[np.argmax(curve[:, 1] > height)]
        points.append(curve[lifted])
        places.append(s[lifted])
    return Midlines.of(stamps.tolist(), points, places)


def instruction(run: MeasuredRun) -> str:
    """Text that tells an operator how to make the planned `run`, and which effects it
    shows.
    """
    standard = STANDARD[run.name]
    return f"fold once more with --policy {run.condition}; it shows {standard.reveals}"


def write_fold(
    folder: Path,
    strip: str,
    fold: Fold,
    noise: Sigma,
    rng: np.random.Generator,
    *,
    wild: float = WILD,
    lost: float = LOST,
) -> None:
    """Write the simulated `fold` into `folder` as a measured run of the strip named
    `strip`, with measurement `noise`.

    `wild` is the share of midline points that are off by up to FARTHEST, `lost` that of
    images.
    """
    folder.mkdir(parents=True)
    touch = _touch(fold, noise, rng)
    end = fold.path.t[-1]
    if touch:
        end = min(touch.time + TIME_AFTER_TOUCH, end)

    stamps = _stamps(end, lost, rng)
    points = [
        _curve(fold, stamp, sigma=noise.profile, wild=wild, rng=rng) for stamp in stamps
    ]
    write_document(folder / RUN, _header(strip, fold, noise))
    write_parquet(folder / TICKS, _ticks(fold, end, stamps, noise, rng))
    write_parquet(folder / PROFILE, _profile(stamps, points))
    write_document(folder / RESULT, _result(touch))


def _header(strip: str, fold: Fold, noise: Sigma) -> dict[str, Any]:
    """Content of the header file for a simulated fold that is written as a measured
    one.
    """
    sigma = noise.model_dump(exclude_none=True, exclude_unset=True)
    header: dict[str, Any] = {"schema": SCHEMA, "strip": strip, "sigma": sigma}
    header |= {"start": "hanging" if fold.path.hanging else "flat", "index": fold.index}
    header |= {"condition": fold.condition} if fold.condition else {}
    return header | {"camera_hz": IMAGE_RATE}


def _result(touch: Touch | None) -> dict[str, Any]:
    """Content of the result file for a simulated fold: its `touch` of the layers, or
    the outcome of a fold without one where that is None.
    """
    if touch is None:
        return {"schema": SCHEMA, "outcome": "path_done"}
    event = {"t_layer_touch": touch.time, "displacement": touch.displacement}
    lengths = {"l1": touch.to_grasped, "l2": touch.to_fixed}
    return {"schema": SCHEMA, "outcome": "layer_touch"} | event | lengths


def _stamps(end: float, lost: float, rng: np.random.Generator) -> Array:
    """Times [s] of the images up to `end` [s], without a random part, the fraction
    `lost`, that is missing.
    """
    stamps = np.arange(rng.uniform(0.0, 1.0 / IMAGE_RATE), end, 1.0 / IMAGE_RATE)
    return stamps[rng.uniform(size=len(stamps)) >= lost]


def _touch(fold: Fold, noise: Sigma, rng: np.random.Generator) -> Touch | None:
    """Touch of the layers in a simulated fold as it would be measured, with noise; None
    where the layers do not touch.
    """
    measured = simulated_touch(fold.path, fold.model, fold.motion)
    if not measured:
        return None
    # equal errors of l1 and l2 whose difference, the displacement, has its stated noise
    lengths = (measured.to_grasped, measured.to_fixed)
    error = noise.displacement
    l1, l2 = rng.normal(lengths, error / np.sqrt(2)).tolist()
    time = measured.time + rng.normal(0.0, noise.touch_time or TOUCH_TIME)
    return Touch(time=time, x=l2, to_grasped=l1, to_fixed=l2)


def _shape(fold: Fold, stamp: float) -> Array:
    """True midline of the strip that an image with the time `stamp` [s] shows, a row of
    x and z [m] for each node.
    """
    time = imaged_time(fold.model.observation, stamp)
    times = fold.shape_t
    after = np.clip(np.searchsorted(times, time), 1, len(times) - 1)
    around = slice(after - 1, after + 1)
    begin, end = times[around]
    fraction = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    first, second = fold.motion.shapes[around]
    shape: Array = (1 - fraction) * first + fraction * second
    return shape


def _curve(
    fold: Fold, stamp: float, sigma: float, wild: float, rng: np.random.Generator
) -> Array:
    """Measured points [m] of the visible midline in one image, a row of x and z for
    each, from the desk contact to the gripper's fingers.
    """
    shape = _shape(fold, stamp)
    arc = fold.arc
    model = fold.model
    lifted = arc[shape[:, 1] > model.observation.contact_height]
    end = arc[-1]
    s = np.arange(min(lifted, default=end), end - HIDDEN_LENGTH, MIDLINE_SPACING)
    curve = CubicSpline(arc, shape)
    column = (len(s), 1)
    across = rng.normal(0.0, sigma, column)
    points = measured_points(model, curve(s))
    points = points + across * left_normals(unit(curve(s, 1)))
    off = rng.uniform(size=column) < wild
    return points + off * rng.uniform(-FARTHEST, FARTHEST, points.shape)


def _ticks(
    fold: Fold, end: float, stamps: Array, noise: Sigma, rng: np.random.Generator
) -> pa.Table:
    """Table of the rows of motion up to `end` [s], with the desk contacts that images
    at the times `stamps` [s] show.
    """
    # what images show
    observation = fold.model.observation
    height = observation.contact_height
    true = np.array([desk_contact(_shape(fold, stamp), height) for stamp in stamps])
    seen = measured_contact(observation, true)
    seen = seen + rng.normal(0.0, noise.contact_x, len(stamps))

    # what the arm reports
    path = fold.path
    t = path.t[path.t <= end]
    x, z, pitch = path.poses[: len(t)].T
    off_x, off_z = rng.normal(0.0, noise.gripper, (len(t), 2)).T
    columns = {"t": t, "x": x + off_x, "z": z + off_z, "pitch": pitch}
    columns |= {"x_cmd": x, "z_cmd": z}
    if noise.force:
        columns |= _forces(fold, t, noise.force, rng)

    contact_x, contact_t = place_contacts(t, stamps, seen)
    return pa.table(columns | {"contact_x": contact_x, "contact_t": contact_t})


def _forces(
    fold: Fold, t: Array, sigma: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Columns of the reported force [N] along x and z at times `t` [s], with noise from
    a separate random generator.
    """
    force = _reported_force(fold, t)
    # leaves the run's draws alone
    (own,) = rng.spawn(1)
    noisy = force + own.normal(0.0, sigma, force.shape)
    return dict(zip(("f_x", "f_z"), noisy.T, strict=True))


def _reported_force(fold: Fold, t: Array) -> Array:
    """Force [N] of the strip on the gripper, a row of x and z for each time in `t` [s],
    as the arm reports it.
    """
    motion = fold.motion
    times = motion.t
    mean = mean_force(times, motion.grip_force)
    return reported_force(fold.model.observation, t, times, mean)


def _profile(stamps: Array, curves: Sequence[Array]) -> pa.Table:
    """Table of the midline points in `curves` [m], one curve for each image time in
    `stamps` [s], with a row for each point.
    """
    counts = [len(curve) for curve in curves]
    numbers = [np.arange(count) for count in counts]
    x, z = np.concatenate([np.empty((0, 2)), *curves]).T
    return pa.table(
        {
            "t": np.repeat(stamps, counts),
            "i": np.concatenate([np.empty(0, dtype=np.int64), *numbers]),
            "x": x,
            "z": z,
        }
    )
