"""Benchmark part: shapes of one strip during a fold, up to the touch."""

from dataclasses import dataclass

import numpy as np

from cell.benchmark.parts.critical import STEP, level_motion
from cell.benchmark.parts.paper_range import knowing
from cell.benchmark.parts.recording_engine import RecordingEngine
from cell.benchmark.results import Curve, Evolution
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.strip.rod.engine import Rod
from drivers.strip.shape import Touch
from drivers.types import Array
from policies.domain import strip_at
from policies.path import TAKEOVER_HEIGHT
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING

LEVEL_MOTION = "level"  # the gripper moves level, as where critical points are measured
LEVEL_HEIGHT = 0.14  # m, of that motion
SHAPE_COUNT = 16
STRIP_PLACE = (0.4, 0.3)  # of the strip in the paper's range


@dataclass(frozen=True, slots=True)
class Evolved:
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
        folds = roll_out(
            knowing(self.policy, [strip]),
            recording,
            strip,
            [describe(strip)],
            settings=Rollout(speed=self.speed, sensing=EXACT_SENSING),
            rng=np.random.default_rng(0),
        )
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
