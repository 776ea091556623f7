"""Simulates motions for many runs and models at once, each only once, with a cache."""

import hashlib
import pickle
import struct
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import Fault
from drivers.strip.engine import StripMotion
from drivers.strip.model import Observation, StripModel
from drivers.strip.observation import mean_force
from drivers.strip.rod.engine import Rod
from drivers.strip.rod.lumping import lattice, needs_terms
from drivers.strip.rod.motions import GripperPath, simulate_all
from drivers.strip.shape import Touch
from drivers.types import Array

SHAPE_PERIOD = 0.01  # s between the shapes that are kept
AT_ONCE = 16  # motions in one call: all their shapes are in memory
LANE_COUNT = 8  # motions that cost no more than one
REMEMBERED = 96 * 2**20  # bytes of motions that are kept: few are asked for again, and soon
SELDOM = 16 * 2**20  # the same, where hardly any is asked for twice


@dataclass(frozen=True, slots=True)
class Resolution:
    """Resolution of the rod: `segments`, its step `dt` [s], and the `tolerance` [rad] of a step's
    solution.
    """

    segments: int
    dt: float
    tolerance: float


COARSE, FINE = Resolution(100, 0.005, 1e-4), Resolution(200, 0.0025, 1e-4)
FINER = Resolution(200, 0.00125, 1e-4)
"""For what the fine rod shows far otherwise than the coarse one."""
ROUGH = Resolution(100, 0.01, 1e-4)
"""For responses alone: half the cost, and a few percent off where nothing jumps."""


@dataclass(frozen=True, slots=True)
class HashedPath:
    """A reported gripper path with the `digest` of its numbers, for the many jobs along it."""

    path: GripperPath
    digest: bytes

    @classmethod
    def of(cls, path: GripperPath) -> Self:
        """`path` with a hash of its rows."""
        h = hashlib.blake2b(bytes([path.hanging]), digest_size=16)
        for array in (path.t, path.poses):
            h.update(np.ascontiguousarray(array).data)
        return cls(path, h.digest())


@dataclass(frozen=True, slots=True)
class HashedModel:
    """A description with the `digest` of all but its observation, for its many jobs."""

    model: StripModel
    digest: bytes

    @classmethod
    def of(cls, model: StripModel) -> Self:
        """`model` with a hash of all but its observation."""
        blind = replace(model, observation=Observation())
        digest = hashlib.blake2b(pickle.dumps(blind, protocol=5), digest_size=16).digest()
        return cls(model, digest)


@dataclass(frozen=True, slots=True)
class Job:
    """A description along a reported gripper path; equal `key`, equal true motion."""

    model: StripModel
    way: GripperPath
    key: bytes

    @classmethod
    def of(cls, hashed: HashedModel, way: HashedPath, contact_height: float) -> Self:
        """A job with the hash of what its true motion depends on; contact is at a height [m]."""
        seen = replace(hashed.model.observation, contact_height=contact_height)
        key = hashed.digest + way.digest + struct.pack("<d", contact_height)
        return cls(replace(hashed.model, observation=seen), way.path, key)


@dataclass(frozen=True, slots=True)
class SimulatedMotion:
    """True motion along a drive: at times `t` (k,) [s] `contact_x` (k,), `force` (k, 2) on the
    gripper and `poses` (k, 3); `shapes` (m, nodes, 2), in single precision, from `begin` [s] on
    every SHAPE_PERIOD seconds, nodes at the shares `arc` (nodes,) of the length; the touch, if any.
    """

    t: Array
    poses: Array
    contact_x: Array
    force: Array
    begin: float
    shapes: NDArray[np.float32]
    arc: Array
    touch: Touch | None

    @property
    def size(self) -> int:
        """Memory use of the motion [bytes]."""
        return int(self.shapes.nbytes + 7 * self.t.nbytes)


class Simulation:
    """Simulates with the rod at one resolution, on `jobs` threads, and caches its results.

    A motion does not depend on what is simulated beside it, nor on how many threads there are.
    """

    def __init__(
        self, grain: Resolution = COARSE, jobs: int = 1, remembered: int = REMEMBERED
    ) -> None:
        self.grain = grain
        self._remembered = remembered
        self._jobs = max(1, jobs)
        self._known: OrderedDict[bytes, SimulatedMotion | None] = OrderedDict()
        self._size = 0

    def __call__(self, drives: Sequence[Job]) -> list[SimulatedMotion | None]:
        """Simulated motion of each of `drives`; None where the rod did not converge."""
        wanted = {d.key: d for d in drives if d.key not in self._known}
        found = {d.key: self._known[d.key] for d in drives if d.key in self._known}
        found |= self._simulate_batches(wanted)
        for key in dict.fromkeys(d.key for d in drives):
            self._remember(key, found[key])
        return [found[d.key] for d in drives]

    def _simulate_batches(self, wanted: dict[bytes, Job]) -> dict[bytes, SimulatedMotion | None]:
        """Simulate in batches of equal length, so that lanes end together, and of equal models.

        A lane that finds its shapes with effort makes the others of its vector wait.
        """
        order = sorted(wanted, key=lambda k: -wanted[k].way.duration)
        fair = LANE_COUNT * -(-len(order) // (LANE_COUNT * self._jobs))
        size = max(LANE_COUNT, min(AT_ONCE, fair))
        batches = [
            like[i : i + size]
            for like in _split_by_terms(order, wanted)
            for i in range(0, len(like), size)
        ]
        asked = [[wanted[k] for k in batch] for batch in batches]
        found: dict[bytes, SimulatedMotion | None] = {}
        with ThreadPoolExecutor(self._jobs) as pool:
            for batch, shown in zip(batches, pool.map(self._batch, asked), strict=True):
                found.update(zip(batch, shown, strict=True))
        return found

    def _batch(self, drives: Sequence[Job]) -> list[SimulatedMotion | None]:
        try:
            return self._together(drives)
        except (Fault, ValueError):  # a strip that cannot hang where its run begins
            if len(drives) == 1:
                return [None]
            return [shown for drive in drives for shown in self._batch([drive])]

    def _together(self, drives: Sequence[Job]) -> list[SimulatedMotion | None]:
        rod = Rod(self.grain.segments, strict=False, tolerance=self.grain.tolerance)
        models, ways = [d.model for d in drives], [d.way for d in drives]
        every = max(1, round(SHAPE_PERIOD / self.grain.dt))
        motions = simulate_all(
            rod, models, ways, dt=self.grain.dt, every=every, precision=np.float32
        )
        return [
            None if failed else self._thin_out(motion)
            for motion, failed in zip(motions, rod.failed, strict=True)
        ]

    def _thin_out(self, motion: StripMotion) -> SimulatedMotion:
        arc = lattice(1.0, self.grain.segments)
        shapes = motion.shapes.astype(np.float32, copy=False)
        if not len(shapes):
            flat = np.stack([arc * motion.poses[0, 0], np.zeros_like(arc)], axis=1)
            shapes = flat[None].astype(np.float32)
        begin = float(motion.t[0]) - self.grain.dt + SHAPE_PERIOD
        force = mean_force(motion.t, motion.grip_force)
        return SimulatedMotion(
            motion.t, motion.poses, motion.contact_x, force, begin, shapes, arc, motion.touch
        )

    def _remember(self, key: bytes, shown: SimulatedMotion | None) -> None:
        if key not in self._known:
            self._size += shown.size if shown else 0
        self._known[key] = shown
        self._known.move_to_end(key)
        while self._size > self._remembered:
            _, gone = self._known.popitem(last=False)
            self._size -= gone.size if gone else 0


def _split_by_terms(order: Sequence[bytes], wanted: Mapping[bytes, Job]) -> list[list[bytes]]:
    """Motions with and without the rod's further terms, in `order`; all together where either are
    few.

    A batch in which one strip needs those terms computes them for every strip.
    """
    rich = {key: needs_terms(wanted[key].model) for key in order}
    parts = [[key for key in order if rich[key] is which] for which in (True, False)]
    return parts if min(map(len, parts)) >= LANE_COUNT else [list(order)]
