"""Simulates the motions of many runs and models at once, and caches the latest."""

import hashlib
import pickle
import struct
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Generic, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import Fault, Unsupported
from drivers.base.types import Array
from drivers.strip.engine import StripMotion, Touch
from drivers.strip.model import ObservationModel, StripModel
from drivers.strip.observation import mean_force
from drivers.strip.rod.engine import GripperPath, Rod, simulate_all
from drivers.strip.rod.lumping import lattice, needs_terms

T = TypeVar("T")
SHAPE_PERIOD = 0.01  # s between the shapes that are kept
AT_ONCE = 16  # motions in one call: all their shapes are in memory
LANE_COUNT = 8  # motions that cost no more than one
REMEMBERED = 96 * 2**20  # bytes of the cache: few motions are asked for again, and soon


class Resolution(NamedTuple):
    """Resolution of a simulated rod: number of `segments`, and time step `dt` [s]."""

    segments: int
    dt: float


COARSE, MEDIUM = Resolution(100, 0.01), Resolution(100, 0.005)
"""Of fits: the medium one for folds in which the fine rod differs much from the coarse
one.
"""
FINE, FINER = Resolution(200, 0.0025), Resolution(200, 0.00125)
"""Of corrections: the finer one where the fine rod differs much from that of the fit.
"""


class Hashed(NamedTuple, Generic[T]):
    """A gripper path or strip model together with a `digest` of its numbers, which is
    computed once for all simulations.
    """

    value: T
    digest: bytes

    @classmethod
    def of(cls, value: T, content: object = None) -> Self:
        """Wrap `value` with a digest of all its numbers, or of those of `content`
        unless that is None.
        """
        numbers = pickle.dumps(value if content is None else content, protocol=5)
        return cls(value, hashlib.blake2b(numbers, digest_size=16).digest())


def hashed_model(model: StripModel) -> Hashed[StripModel]:
    """Wrap the `model` of strip and rig with a digest of its numbers, without those
    that say how cameras and sensors observe it.
    """
    return Hashed.of(model, replace(model, observation=ObservationModel()))


class Job(NamedTuple):
    """One simulation to be run: a strip model along a gripper path, as an elastic rod
    of a given resolution.

    `digest` is that of model and path. Jobs of equal `key` give equal motions.
    """

    model: StripModel
    path: GripperPath
    resolution: Resolution
    digest: bytes

    @property
    def key(self) -> bytes:
        """Digest of all that determines the simulated motion, which is the same for
        jobs that give equal motions.
        """
        return self.digest + struct.pack("<id", *self.resolution)


class SimulatedMotion(NamedTuple):
    """Simulated motion of the gripper and the strip, in which `touch` is when and where
    the strip's layers touch, or None.

    At times `t` (k,) [s]: `poses` (k, 3), `contact_x` (k,) [m] and `force` (k, 2) [N]
    on the gripper. From `begin` [s] on every SHAPE_PERIOD: `shapes` (m, nodes, 2) [m]
    in single precision, with nodes at the shares `arc` (nodes,) of the strip's length.
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
        """Memory [bytes] that the simulated motion takes."""
        return int(self.shapes.nbytes + 7 * self.t.nbytes)

    def index_at(self, time: Array) -> Array:
        """Position of each time in `time` [s] among the simulated shapes, as an index
        with a fraction, which may lie beyond either end.
        """
        return (time - self.begin) / SHAPE_PERIOD


class Simulation:
    """Simulates motions of strips as elastic rods on several `threads`, and keeps the
    latest motions in memory.

    A motion does not depend on what is simulated beside it, nor on how many threads
    there are.
    """

    def __init__(self, threads: int) -> None:
        self._threads = max(1, threads)
        self._cache: OrderedDict[bytes, SimulatedMotion | None] = OrderedDict()
        self._size = 0

    def __call__(self, jobs: Sequence[Job]) -> list[SimulatedMotion | None]:
        """Simulated motion of each of `jobs`, in their order; None where the strip
        cannot be simulated.
        """
        keys = [job.key for job in jobs]
        cache = self._cache
        by_key = dict(zip(keys, jobs, strict=True))
        motions = {key: cache[key] for key in by_key if key in cache}
        motions |= self._simulate_batches(
            {k: j for k, j in by_key.items() if k not in motions}
        )
        for key in by_key:
            self._remember(key, motions[key])
        return [motions[key] for key in keys]

    def _simulate_batches(
        self, jobs: dict[bytes, Job]
    ) -> dict[bytes, SimulatedMotion | None]:
        """Simulate `jobs`, given by their keys, in batches of equal resolution and
        similar duration, one batch at a time on each thread.

        Lanes of a vector then end together: one that takes more effort makes the others
        wait.
        """
        order = sorted(jobs, key=lambda k: -jobs[k].path.duration)
        # whole lanes
        share_of_thread = LANE_COUNT * -(-len(order) // (LANE_COUNT * self._threads))
        size = max(LANE_COUNT, min(AT_ONCE, share_of_thread))
        batches = [
            kind[i : i + size]
            for kind in _split_by_kind(order, jobs)
            for i in range(0, len(kind), size)
        ]
        work = [[jobs[k] for k in batch] for batch in batches]

        motions: dict[bytes, SimulatedMotion | None] = {}
        with ThreadPoolExecutor(self._threads) as pool:
            results = pool.map(self._simulate_batch, work)
            for batch, simulated in zip(batches, results, strict=True):
                motions.update(zip(batch, simulated, strict=True))

        return motions

    def _simulate_batch(self, jobs: Sequence[Job]) -> list[SimulatedMotion | None]:
        """Simulate a batch of jobs together, or one by one where a job cannot start;
        the motion is None for such a job.
        """
        try:
            return self._simulate_together(jobs)
        # one strip finds no rest at the first pose of its gripper
        except (Fault, Unsupported):
            if len(jobs) == 1:
                return [None]
            return [motion for job in jobs for motion in self._simulate_batch([job])]

    def _simulate_together(self, jobs: Sequence[Job]) -> list[SimulatedMotion | None]:
        """Simulate `jobs` of one resolution as a single batch; the motion is None for
        each job that fails on the way.

        Raises Fault or Unsupported where one finds no rest at the first pose of its
        gripper.
        """
        resolution = jobs[0].resolution
        segments, dt = resolution
        rod = Rod(segments, strict=False)
        motions = simulate_all(
            rod,
            [job.model for job in jobs],
            [job.path for job in jobs],
            dt=dt,
            every=max(1, round(SHAPE_PERIOD / dt)),
            precision=np.float32,
        )
        return [
            None if failed else _condense(motion, resolution)
            for motion, failed in zip(motions, rod.failed, strict=True)
        ]

    def _remember(self, key: bytes, motion: SimulatedMotion | None) -> None:
        """Keep a `motion` in memory under `key`, and forget the oldest ones where all
        of them take more than a fixed amount of memory.
        """
        cache = self._cache
        if key not in cache:
            self._size += motion.size if motion else 0
        cache[key] = motion
        cache.move_to_end(key)
        while self._size > REMEMBERED:
            _, oldest = cache.popitem(last=False)
            self._size -= oldest.size if oldest else 0


def _condense(motion: StripMotion, resolution: Resolution) -> SimulatedMotion:
    """Reduce a simulated motion to the quantities that are compared; where it has no
    shapes, the strip lies flat.
    """
    segments, dt = resolution
    t = motion.t
    poses = motion.poses
    shapes = motion.shapes
    arc = lattice(1.0, segments)
    if not len(shapes):  # the strip is flat
        shapes = np.stack([arc * poses[0, 0], np.zeros_like(arc)], axis=1)[None]
    return SimulatedMotion(
        t=t,
        poses=poses,
        contact_x=motion.contact_x,
        force=mean_force(t, motion.grip_force),
        begin=t[0] - dt + SHAPE_PERIOD,
        shapes=shapes.astype(np.float32, copy=False),
        arc=arc,
        touch=motion.touch,
    )


def _split_by_kind(
    order: Sequence[bytes], jobs: Mapping[bytes, Job]
) -> list[list[bytes]]:
    """Split the keys of jobs, kept in `order`, into lists of equal resolution, and
    further by whether the strips need optional terms of the simulation.

    A batch in which one strip needs the rod's optional terms computes them for every
    strip. There is no split by them where either part would not fill a vector.
    """
    by_grain: dict[Resolution, list[bytes]] = {}
    for key in order:
        by_grain.setdefault(jobs[key].resolution, []).append(key)
    kinds: list[list[bytes]] = []
    for of_grain in by_grain.values():
        parts: tuple[list[bytes], list[bytes]] = [], []
        for key in of_grain:
            parts[not needs_terms(jobs[key].model)].append(key)
        kinds += parts if min(map(len, parts)) >= LANE_COUNT else [of_grain]
    return kinds
