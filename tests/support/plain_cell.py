"""Cell of minimal devices: ideal servo, hand without strip, camera that sees noise."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import nan, pi
from types import SimpleNamespace

import numpy as np

from cell.base.config.places import CHECKOUT_CONFIGS, Configs
from cell.base.devices.devices import Devices
from cell.orchestrator.context import FoldInputs, FoldLog
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.run import ControlLoop
from cell.orchestrator.snapshot import (
    CloseHand,
    Drive,
    Hold,
    MoveTo,
    OpenHand,
    Snapshot,
)
from cell.orchestrator.states import State, Trigger
from cell.orchestrator.vision import View
from cell.perception.image_reader import ImageResult, InlineReader
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.installation import Workspace
from drivers.base.motion import TICK, MotionProfile
from drivers.base.types import ZERO_VELOCITY, ArmState, Frame, HandState, Pose, Velocity
from drivers.twin.clock import Rank, TwinClock
from policies.registry import make_policy

CONFIGS = Configs(CHECKOUT_CONFIGS)
LIMITS = CONFIGS.cell().installation.limits
AWAY = Velocity(-0.1, 0.05, 0.0)


class PlainArm:
    """Arm that reaches every commanded pose at once."""

    def __init__(self, clock: TwinClock) -> None:
        self._clock = clock
        self.profile = MotionProfile(LIMITS, Workspace(), Pose(0.6, 0.1, pi / 2))
        self.commands: list[object] = []
        clock.every(TICK, lambda _: self.profile.tick(), Rank.SERVO)

    def connect(self) -> None:
        """Nothing to connect."""

    def state(self) -> ArmState:
        now, profile = self._clock.now(), self.profile
        return ArmState(
            stamp=now,
            arrival=now,
            source="plain",
            pose=profile.pose,
            velocity=profile.velocity,
            commanded=profile.pose,
            moving=profile.moving,
            expired=profile.expired,
        )

    def move_to(self, pose: Pose) -> None:
        self.commands.append(MoveTo(pose))
        self.profile.move_to(pose)

    def set_velocity(self, velocity: Velocity) -> None:
        self.commands.append(Drive(velocity))
        self.profile.set_velocity(velocity)

    def stop(self) -> None:
        self.commands.append(Hold())
        self.profile.stop()

    def close(self) -> None:
        self.profile.stop()


class PlainHand:
    def __init__(self, clock: TwinClock) -> None:
        self._clock = clock
        self.commands: list[object] = []
        self.stopped = 0
        self.moving = False

    def open(self, width: float | None = None) -> None:
        self.commands.append(OpenHand(width))

    def grasp(self) -> None:
        self.commands.append(CloseHand())

    def state(self) -> HandState:
        now = self._clock.now()
        return HandState(
            now, now, "plain", width=0.001, grasped=True, moving=self.moving
        )

    def stop(self) -> None:
        self.stopped += 1


class NoiseCamera:
    """Camera whose frames are random images."""

    rate = 100.0

    def __init__(self, clock: TwinClock) -> None:
        self._clock = clock
        self._count = 0

    def connect(self) -> None:
        """Nothing to connect."""

    def read(self, after: float, timeout: float) -> Frame | None:
        now = self._clock.now()
        if now <= after:
            return None
        self._count += 1
        image = np.full((2, 2, 3), self._count % 251, np.uint8)
        return Frame(now, now, "noise", self._count, image)

    def close(self) -> None:
        """Nothing to close."""


@dataclass
class Bench:
    clock: TwinClock
    arm: PlainArm
    hand: PlainHand
    camera: NoiseCamera
    record: Recorder = field(default_factory=Recorder)
    observers: tuple = ()
    interrupted: Callable[[], bool] = lambda: False
    reader: object = None
    phases: dict | None = None

    def run(self) -> Outcome:
        settings = CONFIGS.cell()
        strip = CONFIGS.strip("denim")
        reader = self.reader or InlineReader(SimpleNamespace(measure=result_of), 0.0)
        policy = make_policy("triangular")
        inputs = FoldInputs(settings.controller, strip, policy, None, reader=reader)
        devices = Devices(
            self.clock, self.arm, self.hand, self.camera, "none", None, None
        )
        watched = self.record, self.observers, self.interrupted
        doing = self.phases or phases()
        return ControlLoop(devices, inputs, FoldLog(), doing, *watched).execute()

    @property
    def now(self) -> float:
        """Time [s] of its clock."""
        return self.clock.now()

    @property
    def at_rest(self) -> bool:
        return not self.arm.profile.moving


def result_of(frame: Frame, gripper: Pose, *, touches: bool, hand=None) -> ImageResult:
    seen = replace(SIGHT, stamp=frame.stamp, sequence=frame.sequence)
    return ImageResult(seen, None)


def plain_bench() -> Bench:
    """All minimal devices at rest on one clock."""
    clock = TwinClock()
    return Bench(clock, PlainArm(clock), PlainHand(clock), NoiseCamera(clock))


def ending(event: Trigger):
    """Phase that ends at once with `event`."""

    def phase(*_):
        yield Hold()
        return event

    return phase


def driving(*_):
    """Phase that drives away and never ends by itself."""
    while True:
        yield Drive(AWAY)


def driven(ticks: int):
    """Phase that drives away for so many `ticks`."""

    def phase(*_):
        for _ in range(ticks):
            yield Drive(AWAY)
        return Trigger.PATH_DONE

    return phase


def phases(**special) -> dict:
    plain = {
        State.PREFLIGHT: ending(Trigger.CHECKED),
        State.GRASP: ending(Trigger.GRASPED),
        State.LIFT: ending(Trigger.LIFTED),
        State.FOLD: driving,
    }
    return plain | {State(name): phase for name, phase in special.items()}


POSE = Pose(0.4, 0.2, pi / 2)
ARM = ArmState(
    10.0, 10.0, "test", POSE, ZERO_VELOCITY, POSE, moving=True, expired=False
)
HAND = HandState(10.0, 10.0, "test", width=0.001, grasped=True, moving=False)
FRAME = Frame(9.97, 9.99, "test", 7, np.zeros((2, 2, 3), np.uint8))
SIGHT = StripMeasurement(
    9.97, 7, 0.3, 1.0, np.zeros((3, 2)), 1.0, (0.5, 0.02), nan, nan
)
GOOD = Snapshot(
    time=10.0,
    state=State.FOLD,
    entered=5.0,
    arm=ARM,
    hand=HAND,
    view=View(frame=FRAME, fresh=True, measurement=SIGHT),
)


def showing(**changes) -> Snapshot:
    return replace(GOOD, view=replace(GOOD.view, **changes))


def of_arm(**changes) -> Snapshot:
    return replace(GOOD, arm=replace(ARM, **changes))
