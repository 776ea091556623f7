"""Simulated world of the twin, a strip on the desk and the hand over it, and the scenes
of its newest past, which the camera renders.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, hypot, sin
from typing import Protocol, Self

import numpy as np

from drivers.base.errors import Fault
from drivers.base.types import GRAVITY, Array, Pose, frozen
from drivers.strip.engine import Observables, Stepper, Touch
from drivers.strip.model import StripModel
from drivers.strip.observation import GrowingOffsets
from drivers.twin.clock import NANOSECONDS, nanoseconds
from drivers.twin.settings import WorldSettings


@dataclass(frozen=True, slots=True)
class WorldState:
    """State of the simulated world at `stamp` [s of the run], in the cell frame.

    `points` (n, 2) midline (x, z) [m] from the fixed edge on, `arc` (n,) its arc length
    [m]; `gripper` the true pose of the fingers, `finger_width` the distance between
    them [m], `holds_strip` whether they hold the strip's edge, `pointer` whether they
    hold the pin of the calibration instead, `strip` whether a strip lies in the cell at
    all.
    """

    stamp: float
    points: Array
    arc: Array
    gripper: Pose
    finger_width: float
    holds_strip: bool
    pointer: bool = False
    strip: bool = True


class History:
    """Buffer of the newest scenes, at regular steps, with linear interpolation between
    them.
    """

    def __init__(self, step: float, memory: float) -> None:
        """Buffer for scenes at every `step` [s] of the last `memory` [s]."""
        self._step = nanoseconds(step)
        self._scenes: deque[WorldState] = deque(
            maxlen=nanoseconds(memory) // self._step + 2
        )

    def add(self, scene: WorldState) -> None:
        """Append a scene, which must be one `step` later than the last scene."""
        self._scenes.append(scene)

    @property
    def newest(self) -> WorldState:
        """Newest scene in the buffer."""
        return self._scenes[-1]

    def at(self, stamp: float) -> WorldState:
        """Scene at `stamp` [s]; Fault `world_unknown` where it is not in the buffer."""
        scenes = self._scenes
        time = nanoseconds(stamp)
        first = nanoseconds(scenes[0].stamp)
        if not first <= time <= nanoseconds(self.newest.stamp):
            raise Fault(
                "world_unknown",
                f"the world at {stamp:.4f} s cannot be shown; known are "
                f"{first / NANOSECONDS:.4f} to {self.newest.stamp:.4f} s",
            )

        index, remainder = divmod(time - first, self._step)
        if remainder == 0:
            return scenes[index]

        return _interpolate(scenes[index], scenes[index + 1], stamp)


def _interpolate(earlier: WorldState, later: WorldState, stamp: float) -> WorldState:
    """Scene at `stamp` [s], linear between two scenes, with the grasp of `earlier`."""
    share = (stamp - earlier.stamp) / (later.stamp - earlier.stamp)
    start = earlier.gripper.as_array()
    end = later.gripper.as_array()
    points = earlier.points
    if points is not later.points:
        points = frozen(points + share * (later.points - points))

    gripper = Pose.from_array(start + share * (end - start))
    width = earlier.finger_width + share * (later.finger_width - earlier.finger_width)
    return replace(
        earlier, stamp=stamp, points=points, gripper=gripper, finger_width=width
    )


@dataclass(frozen=True, slots=True)
class Fingers:
    """Motion of the fingers from `width` [m] at `start` [s] to `target` [m] at `speed`
    [m/s].
    """

    width: float
    target: float
    start: float
    speed: float

    @property
    def end(self) -> float:
        """Time [s] at which the fingers arrive at `target`."""
        return self.start + abs(self.target - self.width) / self.speed

    def at(self, time: float) -> float:
        """Width [m] between the fingers at `time` [s]."""
        travel = self.speed * max(time - self.start, 0.0)
        return float(min(max(self.target, self.width - travel), self.width + travel))


@dataclass(frozen=True, slots=True)
class Grasp:
    """Rigid grasp of a strip: position `along`, `across` [m] and angle `turn` [rad] of
    its edge in the frame of the hand.
    """

    along: float
    across: float
    turn: float

    @classmethod
    def between(cls, hand: Pose, edge: Pose) -> Self:
        """Grasp of a hand at pose `hand` that has closed on an edge at pose `edge`."""
        pitch = hand.pitch
        dx = edge.x - hand.x
        dz = edge.z - hand.z
        c = cos(pitch)
        s = sin(pitch)
        return cls(c * dx + s * dz, c * dz - s * dx, edge.pitch - pitch)

    def edge(self, hand: Pose) -> Pose:
        """Pose of the grasped strip edge while the hand is at the pose `hand`."""
        pitch = hand.pitch
        c = cos(pitch)
        s = sin(pitch)
        return Pose(
            hand.x + c * self.along - s * self.across,
            hand.z + s * self.along + c * self.across,
            pitch + self.turn,
        )


class Plant(Stepper, Protocol):
    """Protocol of an engine that simulates a strip, and that can also release its
    grasped edge.
    """

    def release(self) -> None:
        """Release the grasped edge; later gripper poses have no effect on it."""


class World:
    """Simulated strip on a desk, moved by the reported gripper poses of an arm.

    The gripper's true pose follows from the reported one and the rig of `model`. The
    strip lies flat and still until it is grasped, then starts as the plant does: its
    edge at x = L. It moves in steps of `settings.step`, as far as the gripper's poses
    are known. The world has no clock: its caller calls `advance`.
    """

    def __init__(
        self,
        model: StripModel,
        plant: Plant,
        settings: WorldSettings,
        start: Pose,
        opening: float,
    ) -> None:
        """World with the strip of `model` in `plant`; gripper at `start`, `opening` [m]
        wide.
        """
        self.model = model
        self._plant = plant
        self._settings = settings
        self._steps = 0
        self._path: deque[tuple[float, Callable[[], Pose]]] = deque(
            [(0.0, lambda: start)]
        )
        self._fingers = Fingers(opening, opening, start=0.0, speed=1.0)
        self._pointer = False
        self._offsets = GrowingOffsets(model.rig)
        self._grasp: Grasp | None = None
        self._grasped_at: float | None = None
        plant.reset([model])
        self._arc = frozen(plant.arc()[0])
        self._points = frozen(np.stack([self._arc, np.zeros_like(self._arc)], axis=1))
        # after the newest step of a grasped strip
        self._observed: Observables | None = None
        self._history = History(settings.step, settings.memory)
        self._history.add(self._scene(0.0, start))

    @property
    def time(self) -> float:
        """Time [s] up to which the strip has been simulated."""
        return nanoseconds(self._steps * self._settings.step) / NANOSECONDS

    @property
    def gripper(self) -> Pose:
        """Newest true pose of the gripper."""
        return Pose.from_array(self._offsets.true(self._path[-1][1]().as_array()))

    def add_pose(self, stamp: float, compute: Callable[[], Pose]) -> None:
        """Add the pose that the arm reports at `stamp` [s]; ignored if `stamp` is not
        newer.

        `compute` is called if a step of the strip needs the pose: an arm reports each
        millisecond, the strip steps each five.
        """
        if stamp > self._path[-1][0]:
            self._path.append((stamp, compute))

    def advance(self, time: float) -> None:
        """Simulate the strip up to `time` [s], or as far as the gripper's poses are
        known.
        """
        end = nanoseconds(min(time, self._path[-1][0]))
        while nanoseconds((self._steps + 1) * self._settings.step) <= end:
            self._steps += 1
            reported = self._hand_at(self.time).as_array()
            hand = Pose.from_array(self._offsets.advance(reported))
            if self._grasped_at is not None:
                self._step_strip(hand)
            self._history.add(self._scene(self.time, hand))

    def scene(self, stamp: float) -> WorldState:
        """State of the simulated world at `stamp` [s]; raises Fault `world_unknown`
        where the history does not reach it.
        """
        return self._history.at(stamp)

    def move_fingers(self, fingers: Fingers) -> None:
        """Replace the motion of the fingers by `fingers`."""
        self._fingers = fingers

    def hold_pointer(self, held: bool) -> None:
        """Put the calibration pin between the fingers if `held`, else remove it."""
        self._pointer = held

    def edge_within(self, reach: float, lean: float) -> bool:
        """Whether the strip's edge lies within `reach` [m] and `lean` [rad] of the
        gripper.
        """
        if not self._settings.strip or self._pointer:
            return False
        edge = self._edge()
        x = min(edge.x, self.model.stated_length)
        hand = self.gripper
        distance = hypot(x - hand.x, edge.z - hand.z)
        return distance <= reach and abs(edge.pitch - hand.pitch) <= lean

    def attach(self) -> None:
        """Grasp the strip's edge as it lies between the fingers; raises Fault the
        second time.
        """
        if self._grasped_at is not None:
            raise Fault(
                "grasp_not_simulated",
                "the twin grasps a strip once; start another run for another grasp",
            )
        stated = Pose(self.model.stated_length, 0.0, 0.0)
        self._grasp = Grasp.between(self.gripper, stated)
        self._offsets.start = self.gripper.as_array()
        self._points = frozen(self._plant.shapes()[0])
        self._grasped_at = self.time

    def detach(self) -> None:
        """Release the strip if the fingers hold it."""
        if self._grasp is not None:
            self._grasp = None
            self._plant.release()

    @property
    def holds_strip(self) -> bool:
        """Whether the fingers hold the strip's edge."""
        return self._grasp is not None

    @property
    def load(self) -> float:
        """Weight [N] of the lifted part of a held strip, from the desk contact on."""
        if not self.holds_strip or self._observed is None:
            return 0.0
        lifted = max(float(self._arc[-1] - self._observed.contact_x[0]), 0.0)
        return GRAVITY * float(np.mean(self.model.mechanics.linear_density)) * lifted

    @property
    def grip_force(self) -> tuple[float, float]:
        """Force [N] of the strip on the gripper along the cell's x and z; both are zero
        unless the fingers hold the strip.
        """
        if not self.holds_strip or self._observed is None:
            return 0.0, 0.0
        f_x, f_z = self._observed.grip_force[0].tolist()
        return f_x, f_z

    @property
    def touch(self) -> Touch | None:
        """First touch of the strip's layers, with the time of the run [s]; None before
        the layers touch.
        """
        if self._observed is None or self._grasped_at is None:
            return None
        (since_grasp,) = self._observed.touch  # of the one strip
        if since_grasp is None:
            return None
        return replace(since_grasp, time=since_grasp.time + self._grasped_at)

    @property
    def edge_offset(self) -> float:
        """Distance [m] along x by which the grasped edge lies beyond the fixed one;
        negative where it is short of it.
        """
        return float(self._points[0, 0] - self._points[-1, 0])

    def _step_strip(self, hand: Pose) -> None:
        """Step the strip with the hand at its true pose `hand`."""
        target = hand if self._grasp is None else self._grasp.edge(hand)
        self._observed = self._plant.step(target.as_array()[None], self._settings.step)
        self._points = frozen(self._plant.shapes()[0])

    def _edge(self) -> Pose:
        """Pose of the strip's grasped edge: its last node, with the last segment's
        angle.
        """
        dx, dz = self._points[-1] - self._points[-2]
        x, z = self._points[-1].tolist()
        return Pose(x, z, float(np.arctan2(dz, dx)))

    def _hand_at(self, time: float) -> Pose:
        """Pose of the gripper that the arm reports at `time` [s], linear between the
        known poses; older ones are forgotten.
        """
        path = self._path
        while len(path) > 1 and path[1][0] <= time:
            path.popleft()

        before, earlier = path[0]
        if len(path) == 1 or time <= before:
            return earlier()

        after, later = path[1]
        share = (time - before) / (after - before)
        return Pose.from_array(
            earlier().as_array() * (1 - share) + later().as_array() * share
        )

    def _scene(self, time: float, hand: Pose) -> WorldState:
        """State of the world at `time` [s] with the hand at its true pose `hand`, as
        rendered.
        """
        return WorldState(
            stamp=time,
            points=self._points,
            arc=self._arc,
            gripper=hand,
            finger_width=self._fingers.at(time),
            holds_strip=self.holds_strip,
            pointer=self._pointer,
            strip=self._settings.strip,
        )
