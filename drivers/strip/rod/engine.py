"""The rod as an engine: n strips at once, stepped in compiled code without the GIL."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.errors import Fault, SimulationNotFinite
from drivers.strip.engine import Observables
from drivers.strip.model import StripModel
from drivers.strip.rod import film
from drivers.strip.rod import layout as at
from drivers.strip.rod.band import COLUMNS
from drivers.strip.rod.lanes import WIDTH
from drivers.strip.shape import Touch
from drivers.types import Array


class NotConverged(Fault):
    """Newton's method did not find the next shape of a strip."""

    def __init__(self, strip: int, time: float, dt: float) -> None:
        super().__init__(
            "simulation_not_converged",
            f"the rod found no shape of strip {strip} at {time:.3f} s with steps of {dt:g} s; "
            "use a smaller step, more segments or slower motion",
        )


class Rod:
    """An implicit planar elastic rod of `segments` segments; see `Stepper`.

    `order` 2 is BDF2, 1 backward Euler, which damps like fabric. A batch lies in blocks of
    `WIDTH` strips, one per lane; one or two strips are simulated without lanes. A strip whose
    layers touched keeps its shape and costs nothing once its block is empty.
    """

    def __init__(self, segments: int = 100, order: int = 2) -> None:
        self.segments = segments
        self._again = 1.0 if order == 2 else 0.0

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the strips flat and still; see `Stepper.reset`."""
        at.check(models)
        count, rows = len(models), self.segments + 3
        lanes = 1 if count < 3 else WIDTH
        blocks = -(-count // lanes)
        padded = [*models, *[models[-1]] * (blocks * lanes - count)]
        natures = np.stack([at.nature(model, self.segments) for model in padded])
        self._strips = np.arange(blocks * lanes).reshape(blocks, lanes)
        self._nature = _packed(natures, lanes)
        states = np.zeros((blocks * lanes, rows, at.STATE))
        states[:, 0, at.X] = -natures[:, 0, at.SPAN]
        states[:, 1:, at.X] = np.cumsum(natures[:, :-1, at.SPAN], axis=1) + states[:, :1, at.X]
        states[:, :, at.X1] = states[:, :, at.X]
        self._state = _packed(states, lanes)
        tail = () if lanes == 1 else (WIDTH,)
        self._work = _aligned((rows, at.WORK, *tail))
        self._band = _aligned((2 * rows + 2, COLUMNS, *tail))
        living = (np.arange(blocks * lanes) < count).astype(np.float64)
        self._alive = _packed(living[:, None, None], lanes)
        self._known = np.array([_limits(model) for model in models])
        self._arc = np.stack([at.lattice(m.mechanics.length, self.segments) for m in models])
        lengths = [m.mechanics.length for m in models]
        self._held = np.array([(length, 0.0, 0.0) for length in lengths])
        self._time, self._last_dt = 0.0, np.inf
        self._touch: tuple[Touch | None, ...] = (None,) * count
        self._shown = np.zeros((1, count, film.SHOWN))

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3); see `Stepper.step`."""
        return self.advance(poses[None], dt)

    def advance(self, poses: Array, dt: float) -> Observables:
        """Advance in one call by a step of `dt` [s] to each of `poses` (k, n, 3) in turn.

        Raises SimulationNotFinite, or NotConverged when no shape was found.
        """
        self.follow(poses, dt)
        last = self._shown[-1]
        return Observables(
            time=self._time,
            contact_x=last[:, film.CONTACT_X],
            tip=last[:, [film.TIP_X, film.TIP_Z]],
            holding_force=last[:, film.HOLDING],
            touch=self._touch,
        )

    def follow(self, poses: Array, dt: float, every: int = 0) -> tuple[Array, Array]:
        """`advance`, and what each step showed: (k, n, film.SHOWN), shapes (m, n, nodes, 2).

        `every` step of that many is one of the m shapes, 0 for none. Rows after a strip's
        layer_touch repeat its last ones.
        """
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        count = len(self._arc)
        shown = np.repeat(self._shown[-1:], len(poses), axis=0)
        shapes = np.full((len(poses) // every if every else 0, count, self.segments + 1, 2), np.nan)
        outcome, block, k = film.follow(
            self._nature, self._state, self._work, self._band, self._strips, self._alive,
            self._known, self._arc, self._held, poses, shown, shapes, max(every, 1), self._time, dt,
            self._again * min(dt / self._last_dt, 2.0), self._again,
        )  # fmt: skip
        if outcome != film.FINE:
            time = self._time + (k + 1) * dt
            if outcome == film.NOT_FINITE:
                raise SimulationNotFinite("rod", time)
            raise NotConverged(int(self._strips[block, 0]), time, dt)
        self._shown = shown
        self._time += len(poses) * dt
        self._last_dt = dt
        self._touch = tuple(
            old or _touch(known) for old, known in zip(self._touch, self._known, strict=True)
        )
        return shown, shapes

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m]; see `Stepper.shapes`."""
        rows = _unpacked(self._state, self._strips.shape[1])[: len(self._arc)]
        return np.ascontiguousarray(rows[:, 1:-1, [at.X, at.Z]])

    def arc(self) -> Array:
        """Arc lengths of the nodes (n, nodes) [m]; see `Stepper.arc`."""
        return self._arc


def _limits(model: StripModel) -> Array:
    known = np.full(film.KNOWN, np.nan)
    gap = model.mechanics.touch_gap
    known[film.HEIGHT] = model.observation.contact_height
    known[film.OPENING], known[film.TOUCH_GAP] = 2 * gap, gap
    known[film.LENGTH], known[film.GAP] = model.mechanics.length, np.inf
    return known


def _touch(known: Array) -> Touch | None:
    if np.isnan(known[film.TIME]):
        return None
    s = float(known[film.TOUCH_S])
    x = float(known[film.TOUCH_X])
    length = float(known[film.LENGTH])
    return Touch(float(known[film.TIME]), x, to_grasped=length - s, to_fixed=x)


def _packed(values: Array, lanes: int) -> Array:
    """(n, rows, fields) as blocks (n / lanes, rows, fields[, lanes]), lanes innermost."""
    if lanes == 1:
        return _copied(values)
    blocks = values.reshape(-1, lanes, *values.shape[1:])
    return _copied(np.moveaxis(blocks, 1, -1))


def _unpacked(blocks: Array, lanes: int) -> Array:
    """Inverse of `_packed`."""
    if lanes == 1:
        return blocks
    return np.moveaxis(blocks, -1, 1).reshape(-1, *blocks.shape[1:-1])


def _copied(values: Array) -> Array:
    copy = _aligned(values.shape)
    copy[...] = values
    return copy


def _aligned(shape: tuple[int, ...]) -> Array:
    """Zeros that begin on a cache line, so that no vector straddles two."""
    size = int(np.prod(shape))
    raw: NDArray[np.float64] = np.zeros(size + 8)
    offset = (-raw.ctypes.data % 64) // 8
    return raw[offset : offset + size].reshape(shape)
