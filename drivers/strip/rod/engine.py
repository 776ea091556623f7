"""The rod engine: n strips at once, stepped in compiled code that releases the GIL."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.errors import SimulationNotConverged, SimulationNotFinite
from drivers.strip.engine import Observables
from drivers.strip.model import StripModel
from drivers.strip.rod import follow as of
from drivers.strip.rod.batch import compact, end_strips, fixed_edges, flat_batch, living, midlines
from drivers.strip.rod.follow import follow
from drivers.strip.rod.lumping import check
from drivers.strip.rod.newton import TURN_TOLERANCE
from drivers.strip.rod.static import FINE_STEPS, fit_length, lift_path, settle
from drivers.strip.rod.step import Pace
from drivers.strip.shape import Touch
from drivers.types import Array

LARGEST_RATIO = 2.0  # of a step to the last one: BDF2 is stable up to 1 + sqrt(2)


class Trace(NamedTuple):
    """Observables of n strips over k steps, and midlines at m of these steps.

    `contact_x` (k, n), `tip` (k, n, 2), `holding_force` (k, n), `grip_force` (k, n, 2), and
    `shapes` (m, n, nodes, 2), NaN after a strip's end.
    """

    contact_x: Array
    tip: Array
    holding_force: Array
    grip_force: Array
    shapes: Array


class Rod:
    """Strip engine (`Stepper`): an implicit planar elastic rod of `segments` segments.

    `order` 2 is BDF2, 1 backward Euler, which damps more, like fabric. Newton's method ends when
    segments turn by less than `tolerance` [rad], root mean square: ten times the default moves
    nodes by some micrometres and takes two thirds of the time. Strips occupy the lanes of
    SIMD vectors, and each moves bit for bit as it would in a batch of one. A strip that touched,
    was retired or failed keeps its shape and soon costs nothing. Where Newton's method fails, the
    engine raises SimulationNotConverged or SimulationNotFinite; unless `strict`, the strip ends and
    `failed` marks it.
    """

    def __init__(
        self,
        segments: int = 100,
        order: int = 2,
        *,
        strict: bool = True,
        tolerance: float = TURN_TOLERANCE,
    ) -> None:
        if segments < 20 or order not in (1, 2):
            raise ValueError(f"segments {segments}, order {order}; allowed: 20 or more, 1 or 2")
        self._segments = segments
        self._steady_omega = 1.0 if order == 2 else 0.0
        self._strict, self._tolerance = strict, tolerance

    def reset(self, models: Sequence[StripModel], start: Array | None = None) -> None:
        """Lay the strips flat and at rest, gripped at (stated length, 0) with pitch 0, at time 0.

        With `start` (n, 3) they hang at rest from grippers at these poses instead.
        Raises Unsupported for a part of a model that a rod cannot represent.
        """
        check(models)
        self._batch = flat_batch(models, self._segments)
        self._begin()
        if start is None and any(m.mechanics.length != m.stated_length for m in models):
            self._fit_length(models)
            self._begin()
        elif start is not None:
            settle(self._batch, lift_path(self._batch, np.asarray(start, dtype=np.float64)))
            self._begin()

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3); see `Stepper.step`."""
        return self.advance(poses[None], dt)

    def advance(self, poses: Array, dt: float) -> Observables:
        """Advance by a step of `dt` [s] to each of `poses` (k, n, 3); returns the final state."""
        self._step_all(poses, dt, np.empty((0, 0, 0, 2)), 1)
        last = self._shown
        return Observables(
            time=self._time,
            contact_x=last[:, of.CONTACT_X],
            tip=last[:, of.TIP_X : of.TIP_Z + 1],
            holding_force=last[:, of.HOLDING],
            grip_force=last[:, of.GRIP_X : of.GRIP_Z + 1],
            touch=self.touch,
        )

    def follow(self, poses: Array, dt: float, every: int = 0, memory: Array | None = None) -> Trace:
        """Advance by a step of `dt` [s] to each of `poses` (k, n, 3); returns observables of each.

        Shapes are kept of each `every`th step, 0 for none, in `memory` (m or more, n, nodes, 2) if
        given.
        """
        count = len(poses) // every if every else 0
        shapes = np.empty((count, *self._batch.arc.shape, 2)) if memory is None else memory[:count]
        shapes.fill(np.nan)
        shown = self._step_all(poses, dt, shapes, max(every, 1))
        tip = shown[:, :, of.TIP_X : of.TIP_Z + 1]
        grip = shown[:, :, of.GRIP_X : of.GRIP_Z + 1]
        return Trace(shown[:, :, of.CONTACT_X], tip, shown[:, :, of.HOLDING], grip, shapes)

    def retire(self, gone: NDArray[np.bool_]) -> None:
        """End the strips `gone` (n,): they keep their shape and are no longer computed."""
        self._batch = compact(end_strips(self._batch, gone))

    @property
    def touch(self) -> tuple[Touch | None, ...]:
        """Layer touch of each strip so far, None without one."""
        return self._touch

    @property
    def living(self) -> NDArray[np.bool_]:
        """Mask (n,) of the strips that are still simulated."""
        return living(self._batch)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Mask (n,) of the strips that failed to converge."""
        failed: NDArray[np.bool_] = np.isfinite(self._batch.known[:, of.FAILED])
        return failed

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] of all strips, from the fixed to the grasped edge."""
        return midlines(self._batch)

    def arc(self) -> Array:
        """Arc lengths (n, nodes) [m] of the nodes from the fixed edge, closer towards the grip."""
        return np.array(self._batch.arc)

    def _fit_length(self, models: Sequence[StripModel]) -> None:
        """Lay strips out to their stated lengths; where the solver fails, again more slowly."""
        try:
            fit_length(self._batch, models)
        except SimulationNotConverged:
            self._batch = flat_batch(models, self._segments)
            self._begin()
            fit_length(self._batch, models, FINE_STEPS)

    def _begin(self) -> None:
        count = len(self._batch.arc)
        self._time, self._last = 0.0, np.inf
        self._touch: tuple[Touch | None, ...] = (None,) * count
        self._touched: NDArray[np.bool_] = np.zeros(count, dtype=bool)
        self._shown = np.zeros((count, of.FIELDS_SHOWN))

    def _step_all(self, poses: Array, dt: float, shapes: Array, every: int) -> Array:
        """Step along `poses` (k, n, 3); returns observables (k, n, FIELDS_SHOWN) of each step."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        if poses.shape[1:] != self._batch.held.shape:
            raise ValueError(f"poses {poses.shape}; expected (k, {len(self._batch.held)}, 3)")
        shown = np.empty((len(poses), *self._shown.shape))
        shown[:] = self._shown
        omega = self._steady_omega * min(dt / self._last, LARGEST_RATIO)
        pace = Pace(dt, omega, self._steady_omega, self._tolerance)
        ended = follow(self._batch, poses, shown, shapes, every, self._time, pace)
        self._time += len(poses) * dt
        self._last = dt
        if len(shown):
            self._shown = shown[-1]
        if ended:
            self._record_touches()
            self._batch = compact(self._batch)
        return shown

    def _record_touches(self) -> None:
        """Record new layer touches; raises for a strip that failed if the engine is strict."""
        known = self._batch.known
        touched = np.isfinite(known[:, of.TIME])
        touch, edges = list(self._touch), fixed_edges(self._batch)
        for new in np.flatnonzero(touched & ~self._touched):
            touch[new] = _touch(known[new], float(edges[new]))
        self._touch, self._touched = tuple(touch), touched
        if self._strict and self.failed.any():
            i = int(np.argmax(self.failed))
            time = float(known[i, of.FAILED])
            if not np.isfinite(self._batch.held[i]).all():
                raise SimulationNotFinite("rod", time)
            raise SimulationNotConverged("rod", i, time)


def _touch(known: Array, edge: float) -> Touch:
    """Layer touch of a strip from its `known` (KNOWN_SIZE,) and its fixed edge at x = `edge`."""
    time, x, s = (float(known[field]) for field in (of.TIME, of.TOUCH_X, of.TOUCH_S))
    return Touch(time, x, to_grasped=float(known[of.LENGTH]) - s, to_fixed=x - edge)
