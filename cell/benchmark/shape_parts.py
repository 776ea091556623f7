"""Parts of a benchmark on shapes and paths: critical points, evolution, adaptation, laid strips."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cell.benchmark.range_parts import RecordingEngine, fold_all
from cell.benchmark.results import (
    Adaptation,
    CriticalPoints,
    Curve,
    Evolution,
    Laid,
    finite_or_none,
)
from drivers.errors import CellError
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.strip.shape import Touch
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.domain import DAMPING_RATIO, strip_at
from policies.path import TAKEOVER_HEIGHT, Path
from policies.planned import plan, raise_path
from policies.rollout import Rollout
from policies.sensing import EXACT_SENSING

STEP = 0.005  # s
SEGMENTS = 100
MOTION_COST = 0.002  # s, about, of a motion at 1 m/s
LIFT_SPEED = 0.1  # m/s, up to where the level motion begins
PATH_END = -0.15  # m, where the level motion ends
DWELL_TIME = 3.0  # s at rest before it: three times the slowest fabric's retardation


@dataclass(frozen=True, slots=True)
class CriticalPart:
    """Benchmark part: level motions at `speed` [m/s] and each of `heights` [m], on many strips."""

    speed: float
    heights: tuple[float, ...]
    stiffnesses: int
    dampings: int
    of: str

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        heights = ", ".join(f"{height:g}" for height in self.heights)
        counts = f"{self.stiffnesses} x {self.dampings}"
        return f"critical points at {self.speed} after rest over {counts}, heights {heights}"

    @property
    def cost(self) -> float:
        """Estimated time [s]."""
        return MOTION_COST * len(self.heights) * self.stiffnesses * self.dampings / self.speed

    def measure(self) -> CriticalPoints:
        """Find the gripper's x [m] at the layers' first touch, for every strip at every height."""
        u, v = np.linspace(0, 1, self.stiffnesses), np.linspace(0, 1, self.dampings)
        strips = [strip_at(a, b) for a, b in product(u, v)]
        found = [self._first_touch(height, strips).reshape(len(u), -1) for height in self.heights]
        return CriticalPoints(
            speed=self.speed,
            heights=self.heights,
            bending_lengths=tuple(strip_at(a, 0.0).bending_length for a in u),
            dampings=tuple(float(DAMPING_RATIO**b) for b in v),
            x=tuple(tuple(map(finite_or_none, rows)) for rows in found),
        )

    def _first_touch(self, height: float, strips: Sequence[StripFile]) -> Array:
        """Gripper x (n,) [m] at each strip's first touch, NaN without one."""
        length = strips[0].length
        poses = level_motion(length, height, self.speed)
        rod = Rod(SEGMENTS, strict=False)
        rod.reset([describe(strip) for strip in strips])
        touches = rod.advance(np.repeat(poses[:, None], len(strips), axis=1), STEP).touch
        times = np.arange(1, len(poses) + 1) * STEP
        ends = np.array([np.nan if touch is None else touch.time for touch in touches])
        return np.where(np.isfinite(ends), np.interp(ends, times, poses[:, 0]), np.nan)


def level_motion(length: float, height: float, speed: float) -> Array:
    """Poses (k, 3) every `STEP`: up the triangle's leg to `height`, a rest, level to `PATH_END`."""
    path = Path.through(np.array([(length, 0.0), (length - height, height), (PATH_END, height)]))
    rise = np.sqrt(2) * height
    up = np.arange(STEP, rise / LIFT_SPEED, STEP) * LIFT_SPEED
    rest = np.full(round(DWELL_TIME / STEP), rise)
    along = rise + np.arange(STEP, (path.length - rise) / speed, STEP) * speed
    return path.poses(np.concatenate([up, rest, along]))


LEVEL_MOTION = "level"  # the gripper moves level, as where critical points are measured
LEVEL_HEIGHT = 0.14  # m, of that motion
SHAPE_COUNT = 16
STRIP_PLACE = (0.4, 0.3)  # of the strip in the paper's range


@dataclass(frozen=True, slots=True)
class EvolutionPart:
    """Benchmark part: shapes of a strip of medium stiffness folded by `policy`, or level."""

    policy: str
    speed: float
    of: str
    cost: float = 1.0

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"shapes under {self.policy} at {self.speed}"

    def measure(self) -> Evolution:
        """Fold the strip and return its recorded shapes."""
        seen = (
            self._shapes_of_level_motion()
            if self.policy == LEVEL_MOTION
            else self._shapes_of_fold()
        )
        return Evolution(
            policy=self.policy,
            bending_length=strip_at(*STRIP_PLACE).bending_length,
            shapes=tuple(curve(shape) for shape in seen.shapes),
            contacts=tuple(seen.contacts.tolist()),
            headings=tuple(seen.headings.tolist()),
            path=curve(seen.path),
            touch_x=None if seen.touch is None else seen.touch.x,
            displacement=None if seen.touch is None else seen.touch.displacement,
        )

    def _shapes_of_level_motion(self) -> "_Shapes":
        """Record the strip's shapes under the level motion, up to the touch."""
        strip = strip_at(*STRIP_PLACE)
        poses = level_motion(strip.length, LEVEL_HEIGHT, self.speed)
        t = np.arange(1.0, len(poses) + 1.0) * STEP
        model = describe(strip)
        motion = simulate(Rod(), model, t, poses, dt=STEP, shapes=True)
        path = motion.poses[:, :2]
        return _Shapes.of(motion.shapes, motion.contact_x, path, motion.touch, LEVEL_HEIGHT - 1e-9)

    def _shapes_of_fold(self) -> "_Shapes":
        """Record the strip's shapes in a fold by the policy, from take-over to touch."""
        strip, recording = strip_at(*STRIP_PLACE), RecordingEngine(Rod(), shapes=True)
        settings = Rollout(speed=self.speed, sensing=EXACT_SENSING)
        folds = fold_all(self.policy, [strip], recording, settings)
        end = int(recording.frames[0])
        shapes = np.array(recording.midlines[:end])[:, 0]
        contacts = np.array(recording.contacts[:end])[:, 0]
        return _Shapes.of(shapes, contacts, folds.trace[:end, 0], folds.touch[0], TAKEOVER_HEIGHT)


@dataclass(frozen=True, slots=True)
class _Shapes:
    """Recorded shapes (m, nodes, 2), contacts (m,), headings (m,) and the whole path (k, 2)."""

    shapes: Array
    contacts: Array
    headings: Array
    path: Array
    touch: Touch | None

    @classmethod
    def of(
        cls, shapes: Array, contacts: Array, path: Array, touch: Touch | None, height: float
    ) -> "_Shapes":
        """Choose shapes at equal time intervals from where the gripper reaches `height` [m]."""
        begin = int(np.argmax(path[:, 1] >= height))
        chosen = np.unique(np.linspace(begin, len(shapes) - 1, SHAPE_COUNT).round().astype(int))
        way = np.gradient(path, axis=0)
        headings = np.arctan2(way[:, 1], way[:, 0])
        return cls(shapes[chosen], contacts[chosen], headings[chosen], path, touch)


def curve(points: Array) -> Curve:
    """Points (k, 2) [m] as plain numbers, rounded to a hundredth of a millimetre."""
    return tuple((round(float(x), 5), round(float(z), 5)) for x, z in points)


STIFFNESSES = 7
DAMPING_SHARE = 0.3  # place in the paper's range


@dataclass(frozen=True, slots=True)
class AdaptationPart:
    """Benchmark part: gripper paths of `policy` over the paper's range of stiffness."""

    policy: str
    speed: float
    of: str
    cost: float = 1.0

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"adaptation of {self.policy} at {self.speed}"

    def measure(self) -> Adaptation:
        """Fold one strip of each stiffness, with exact observations."""
        strips = [strip_at(u, DAMPING_SHARE) for u in np.linspace(0.0, 1.0, STIFFNESSES)]
        settings = Rollout(speed=self.speed, sensing=EXACT_SENSING)
        folds = fold_all(self.policy, strips, Rod(), settings)
        ends = [  # number of decisions up to the touch
            len(folds.trace) if touch is None else int(np.ceil(touch.time / settings.period))
            for touch in folds.touch
        ]
        return Adaptation(
            policy=self.policy,
            bending_lengths=tuple(strip.bending_length for strip in strips),
            paths=tuple(curve(folds.trace[:end, i]) for i, end in enumerate(ends)),
            displacements=finite_or_none(folds.displacement),
        )


LINKS = 120
SPEED, LAY_SPEED = 0.1, 0.05  # m/s
HELD, RELEASED = 0.5, 1.5  # s of rest


@dataclass(frozen=True, slots=True)
class LaidPart:
    """Benchmark part: a laid strip at `stiffness`, its place in the paper's range from 0 to 1."""

    stiffness: float
    of: str
    cost: float = 8.0

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"laid strip at {self.stiffness:.3g} on {LINKS} links"

    def measure(self) -> Laid:
        """Fold on the planned path, lay the edge on the fixed one, release it, return the shape."""
        strip = strip_at(self.stiffness, DAMPING_SHARE)
        chain = Chain(LINKS)
        chain.reset([describe(strip)])
        path = raise_path(strip.length, float(plan([strip], SPEED)[0]))
        touch, pose = _fold_and_lay(chain, path)
        end = np.array([touch.x - touch.to_grasped, strip.thickness, np.pi])
        steps = round(float(np.hypot(*(end - pose)[:2])) / LAY_SPEED / STEP)
        for share in np.linspace(0.0, 1.0, steps):
            chain.step((pose + share * (end - pose))[None], STEP)
        _hold_still(chain, end, HELD)
        chain.release()
        _hold_still(chain, end, RELEASED)
        return Laid(bending_length=strip.bending_length, shape=curve(chain.shapes()[0]))


def _fold_and_lay(chain: Chain, path: Path) -> tuple[Touch, Array]:
    for pose in path.poses(np.arange(STEP, path.length / SPEED, STEP) * SPEED):
        touch = chain.step(pose[None], STEP).touch[0]
        if touch is not None:
            return touch, pose
    raise CellError("the layers never met")


def _hold_still(chain: Chain, pose: Array, seconds: float) -> None:
    for _ in range(round(seconds / STEP)):
        chain.step(pose[None], STEP)
