"""Rod engine: simulates n strips at once in compiled code that releases the GIL."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import SimulationNotConverged, SimulationNotFinite
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array
from drivers.strip.engine import Observables, StripMotion, Touch
from drivers.strip.model import StripModel
from drivers.strip.observation import true_path
from drivers.strip.rod import layout as at
from drivers.strip.rod.batch import compact, end_strips, flat_batch, living, midlines
from drivers.strip.rod.blocks import Output, step_along
from drivers.strip.rod.lumping import check
from drivers.strip.rod.static import FINE_STEPS, fit_length, lift_path, settle
from drivers.strip.rod.time_step import Pace

PIECE_TIME = 0.5  # s of motion in one compiled call: a batch closes up between calls
ROUNDING = 1e-9  # steps, by which a touch at the end of a step may seem to be after it
FEWEST_SEGMENTS = 20
LARGEST_RATIO = 2.0  # of a step to the one before: BDF2 is stable up to 1 + sqrt(2)


class Trace(NamedTuple):
    """Observables of n simulated strips over k steps, and their midlines at m of these
    steps.

    `contact_x` (k, n), `holding_force` (k, n), `grip_force` (k, n, 2), and `shapes` (m,
    n, nodes, 2), NaN after a strip's end.
    """

    contact_x: Array
    holding_force: Array
    grip_force: Array
    shapes: Array


class Rod:
    """Strip engine that simulates each of n strips as an implicit planar elastic rod of
    `segments` segments, all in one batch.

    Strips occupy the lanes of SIMD vectors, and each moves bit for bit as it would in a
    batch of one. A strip that touched, was retired or failed keeps its shape and soon
    costs nothing; `touch` holds each strip's first touch of its layers or None. Where
    Newton's method fails, the engine raises SimulationNotConverged or
    SimulationNotFinite; unless `strict`, the strip ends and `failed` marks it.
    """

    def __init__(self, segments: int = 100, *, strict: bool = True) -> None:
        if segments < FEWEST_SEGMENTS:
            raise ValueError(f"segments {segments}; allowed: {FEWEST_SEGMENTS} or more")
        self._segments = segments
        self._strict = strict

    def reset(self, models: Sequence[StripModel], start: Array | None = None) -> None:
        """Lay the strips flat and at rest at time 0, each gripped at x = its stated
        length, z = 0, pitch 0.

        With `start` (n, 3) they hang at rest from grippers at these poses instead.
        Raises Unsupported for a part of a model that a rod cannot represent.
        """
        check(models)
        self._batch = flat_batch(models, self._segments)
        self._begin()
        if start is None and any(
            model.mechanics.length != model.stated_length for model in models
        ):
            self._fit_length(models)
            self._begin()
        elif start is not None:
            settle(
                self._batch, lift_path(self._batch, np.asarray(start, dtype=np.float64))
            )
            self._begin()

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance the strips by `dt` [s] to gripper `poses` (n, 3) [m, m, rad] at the
        step's end.
        """
        return self.advance(poses[None], dt)

    def advance(self, poses: Array, dt: float) -> Observables:
        """Step the n strips to each of k gripper `poses` (k, n, 3) [m, m, rad], `dt`
        [s] apart; returns the last observables.
        """
        self._step_all(poses, dt, np.empty((0, 0, 0, 2)), every=1)
        last = self._observed
        return Observables(
            contact_x=last[:, at.CONTACT_X],
            tip=last[:, at.TIP_X : at.TIP_Z + 1],
            holding_force=last[:, at.HOLDING],
            grip_force=last[:, at.GRIP_X : at.GRIP_Z + 1],
            touch=self.touch,
        )

    def trace(self, poses: Array, dt: float, every: int = 0) -> Trace:
        """Step the n strips to each of k gripper `poses` (k, n, 3) [m, m, rad], `dt`
        [s] apart; returns the observables of all steps.

        Midlines are of every `every`th step, 0 for none.
        """
        count = len(poses) // every if every else 0
        shapes = np.full((count, *self._batch.arc.shape, 2), np.nan)
        observed = self._step_all(poses, dt, shapes, max(every, 1))
        grip = observed[:, :, at.GRIP_X : at.GRIP_Z + 1]
        return Trace(
            contact_x=observed[:, :, at.CONTACT_X],
            holding_force=observed[:, :, at.HOLDING],
            grip_force=grip,
            shapes=shapes,
        )

    def retire(self, retired: NDArray[np.bool_]) -> None:
        """End the strips in the mask `retired` (n,): they keep their shapes and take no
        more computing time.
        """
        self._batch = compact(end_strips(self._batch, retired))

    @property
    def living(self) -> NDArray[np.bool_]:
        """Mask (n,) of the strips that are still simulated."""
        return living(self._batch)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Mask (n,) of the strips for which Newton's method failed to converge."""
        failed: NDArray[np.bool_] = np.isfinite(self._batch.monitor[:, at.FAILURE_TIME])
        return failed

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] of all strips, from the fixed to the grasped
        edge.
        """
        return midlines(self._batch)

    def arc(self) -> Array:
        """Arc lengths (n, nodes) [m] of the nodes from the fixed edge, denser near the
        grip.
        """
        return np.array(self._batch.arc)

    def _fit_length(self, models: Sequence[StripModel]) -> None:
        """Move the gripped edge of each strip to its stated length, in smaller steps
        where the solver fails.
        """
        try:
            fit_length(self._batch, models)
        except SimulationNotConverged:
            self._batch = flat_batch(models, self._segments)
            self._begin()
            fit_length(self._batch, models, FINE_STEPS)

    def _begin(self) -> None:
        """Start a new motion at time 0, and forget touches, observables and the length
        of the last step.
        """
        count = len(self._batch.arc)
        self._time = 0.0
        self._last = np.inf
        self.touch: tuple[Touch | None, ...] = (None,) * count
        self._observed = np.zeros((count, at.OBSERVABLE_COUNT))

    def _step_all(self, poses: Array, dt: float, shapes: Array, every: int) -> Array:
        """Step n strips along k gripper `poses` (k, n, 3) [m, m, rad]; returns their
        observables (k, n, OBSERVABLE_COUNT).
        """
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        if poses.shape[1:] != self._batch.grip.shape:
            raise ValueError(
                f"poses {poses.shape}; expected (k, {len(self._batch.grip)}, 3)"
            )

        observed = np.empty((len(poses), *self._observed.shape))
        observed[:] = self._observed
        pace = Pace(
            start=self._time,
            h=dt,
            omega=min(dt / self._last, LARGEST_RATIO),
            next_omega=1.0,
        )
        ended = step_along(self._batch, poses, Output(observed, shapes, every), pace)
        self._time += len(poses) * dt
        self._last = dt
        if len(observed):
            self._observed = observed[-1]
        if ended:
            self._record_touches()
            self._batch = compact(self._batch)

        return observed

    def _record_touches(self) -> None:
        """Read the layer touches of all strips; a strict engine raises an error for a
        strip that failed.
        """
        batch = self._batch
        strips = zip(batch.monitor, batch.arc, midlines(batch), strict=True)
        self.touch = tuple(_touch(*strip) for strip in strips)
        if self._strict and self.failed.any():
            i = int(np.argmax(self.failed))
            time = float(batch.monitor[i, at.FAILURE_TIME])
            if not np.isfinite(batch.grip[i]).all():
                raise SimulationNotFinite("rod", time)
            raise SimulationNotConverged("rod", i, time)


def _touch(monitor: Array, arc: Array, midline: Array) -> Touch | None:
    """Layer touch in a strip's `monitor` (MONITOR_SIZE,), placed on its `midline`
    (nodes, 2) [m]; None without one.
    """
    time, x, s = monitor[[at.TOUCH_TIME, at.TOUCH_X, at.TOUCH_S]].tolist()
    return None if np.isnan(time) else Touch.in_shape(time, x, s, arc, midline)


class GripperPath(NamedTuple):
    """Gripper path as an arm reports it: times `t` (m,) [s] and `poses` (m, 3) [m, m,
    rad]; `hanging` if the strip is lifted at its start.
    """

    t: Array
    poses: Array
    hanging: bool = False

    @property
    def duration(self) -> float:
        """Time [s] from the first to the last pose of the path."""
        return float(self.t[-1] - self.t[0])


def simulate_all(
    rod: Rod,
    models: Sequence[StripModel],
    paths: Sequence[GripperPath],
    *,
    dt: float,
    every: int,
    precision: type[np.floating] = np.float64,
) -> list[StripMotion]:
    """Simulate each of `models` along its path of `paths`, all in one batch, in steps
    of `dt` [s].

    True grip paths follow from the models' rigs. Every `every`th step keeps its shape,
    0 for none; `shapes` then has (k // every, nodes, 2), rounded to `precision`. A
    motion ends where its layers touch or at the end of its path.
    """
    paths = [_true_path(model, path) for model, path in zip(models, paths, strict=True)]
    counts = [max(1, round(path.duration / dt)) for path in paths]
    poses = np.stack([_sample(path, dt, max(counts)) for path in paths], axis=1)

    rod.reset(models, _starts(models, paths))
    pieces = [
        piece._replace(shapes=piece.shapes.astype(precision))
        for piece in _trace_in_pieces(
            rod, poses, counts=np.array(counts), dt=dt, every=every
        )
    ]
    trace = Trace(*(np.concatenate(parts) for parts in zip(*pieces, strict=True)))

    stride = every or len(poses) + 1
    motions = []
    for i, (path, count) in enumerate(zip(paths, counts, strict=True)):
        steps, touch = _end(rod.touch[i], min(count, len(trace.contact_x)), dt)
        begin = path.t[0]
        if touch is not None:
            touch = replace(touch, time=begin + touch.time)
        motion = StripMotion(
            t=begin + dt * np.arange(1, steps + 1),
            poses=poses[:steps, i],
            contact_x=trace.contact_x[:steps, i],
            holding_force=trace.holding_force[:steps, i],
            grip_force=trace.grip_force[:steps, i],
            shapes=np.ascontiguousarray(trace.shapes[: steps // stride, i]),
            touch=touch,
        )
        motions.append(motion)
    return motions


def _end(touch: Touch | None, count: int, dt: float) -> tuple[int, Touch | None]:
    """Number of steps of `dt` [s] up to the layers' `touch`, and the touch; `count` and
    None where it comes later.
    """
    if touch is None or touch.time > count * dt:
        return count, None
    return min(count, int(np.ceil(touch.time / dt - ROUNDING))), touch


def _starts(models: Sequence[StripModel], paths: Sequence[GripperPath]) -> Array | None:
    """Gripper poses (n, 3) [m, m, rad] at which the n strips begin their motion; None
    where all strips begin flat on the desk.
    """
    if not any(path.hanging for path in paths):
        return None
    flat = [(model.stated_length, 0.0, 0.0) for model in models]
    hung = [path.poses[0] for path in paths]
    return np.where([[path.hanging] for path in paths], hung, flat)


def _trace_in_pieces(
    rod: Rod, poses: Array, counts: NDArray[np.int_], dt: float, every: int
) -> Iterator[Trace]:
    """Yield the strips' traces along gripper `poses` (k, n, 3) [m, m, rad], in pieces
    of PIECE_TIME seconds, until all strips have ended.

    Strip i ends with the piece in which step `counts[i]` lies; `dt`, `every` are as in
    `Rod.trace`.
    """
    stride = max(every, 1)
    piece = max(1, round(PIECE_TIME / dt) // stride) * stride
    for begin in range(0, len(poses), piece):
        yield rod.trace(poses[begin : begin + piece], dt, every)
        rod.retire(counts <= begin + piece)
        if not rod.living.any():
            return


def _true_path(model: StripModel, path: GripperPath) -> GripperPath:
    t, poses = true_path(model.rig, path.t, path.poses, hanging=path.hanging)
    return path._replace(t=t, poses=poses)


def _sample(path: GripperPath, dt: float, count: int) -> Array:
    """Poses (count, 3) [m, m, rad] of the gripper `path` every `dt` [s]; after its end
    the last pose repeats.
    """
    times = path.t[0] + dt * np.arange(1, count + 1)
    return interpolate_columns(times, path.t, path.poses)
