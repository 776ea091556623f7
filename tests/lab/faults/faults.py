"""Faults of the campaign by name, each with the injection that changes a running cell."""

import math
import os
import resource
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from drivers.errors import Fault
from drivers.strip.file import StripFile
from drivers.types import ArmState, HandState, Pose, Velocity
from policies.path import Path
from policies.policy import Decision, Observation, Policy
from tests.lab.faults import failing
from tests.lab.faults.failing import Failing, Spoil

HOLLOW = 60.0  # N of a false reading
DISK_ROOM = 4096  # bytes that a full disk still takes in a file
LONGEST_TICK = 0.02  # s between two velocities, of which a lagging arm takes account
T = TypeVar("T")


class FailingPolicy:
    """A policy whose decisions pass through `otherwise` once that is set."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self.name = policy, policy.name
        self.otherwise: Callable[[Decision], Decision] = lambda decision: decision

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Prepare to fold."""
        self._policy.reset(strip, speed, count)

    def lift(self) -> Path:
        """Path of the policy, whose first section lifts the edge."""
        return self._policy.lift()

    def decide(self, observation: Observation) -> Decision:
        """Decision of the policy as the fault alters it."""
        return self.otherwise(self._policy.decide(observation))


@dataclass(frozen=True, slots=True)
class Scene:
    """Devices and policy of one fold that can fail; `moved` [px] is the image shift of 2 mm."""

    cell: Failing
    policy: FailingPolicy
    moved: tuple[float, float]


Strike = Callable[[Scene], None]


@dataclass(frozen=True, slots=True)
class Injection:
    """Fault to `strike` with, the `arm` that can suffer it, and whether it `spares` the record."""

    strike: Strike
    arm: str = "twin"
    spares: bool = True


def camera(spoil: Spoil) -> Injection:
    """Fault of the camera: its frames pass through `spoil`."""

    def strike(scene: Scene) -> None:
        scene.cell.camera.spoil = spoil

    return Injection(strike)


def moved_camera(scene: Scene) -> None:
    """Fault of the camera: a nudge shifts the image by 2 mm along the desk."""
    scene.cell.camera.spoil = failing.shift(scene.moved)


def reports(change: Callable[[ArmState], ArmState]) -> Injection:
    """Fault of the arm: its states pass through `change`."""

    def strike(scene: Scene) -> None:
        scene.cell.arm.reports = change

    return Injection(strike)


def stale(scene: Scene) -> None:
    """Fault of the arm: it repeats its first state from now on."""
    scene.cell.arm.reports = _repeat_first(ArmState)


def _repeat_first(_: type[T]) -> Callable[[T], T]:
    """Make a function that returns the argument of its first call on every call."""
    states: list[T] = []

    def repeat(state: T) -> T:
        states.append(state)
        return states[0]

    return repeat


@dataclass(slots=True)
class _Lag:
    """Arm that moves at half of each velocity, and reports the pose that was commanded."""

    now: Callable[[], float]
    last: float = 0.0  # s, when a velocity last came
    lost_x: float = 0.0  # m, not moved so far
    lost_z: float = 0.0

    def follow(self, velocity: Velocity) -> Velocity:
        now = self.now()
        span = min(now - self.last, LONGEST_TICK)
        self.last = now
        self.lost_x += 0.5 * velocity.vx * span
        self.lost_z += 0.5 * velocity.vz * span
        return replace(velocity, vx=0.5 * velocity.vx, vz=0.5 * velocity.vz)

    def report(self, state: ArmState) -> ArmState:
        due = state.commanded
        return replace(state, commanded=replace(due, x=due.x + self.lost_x, z=due.z + self.lost_z))


def lagging(scene: Scene) -> None:
    """Fault of the arm: it follows at half of each velocity, and reports the commanded pose."""
    lag = _Lag(scene.cell.clock.now)
    scene.cell.arm.follows, scene.cell.arm.reports = lag.follow, lag.report


def refusing(scene: Scene) -> None:
    """Fault of the arm: it refuses every command."""
    scene.cell.arm.refusal = Fault("motion_refused", "the robot refuses the command")


def deaf(scene: Scene) -> None:
    """Fault of the arm: it ignores velocity commands."""
    scene.cell.arm.follows = lambda _: None


def beside(state: ArmState) -> ArmState:
    """Fault of the arm: it reports a pose outside the workspace, measured and commanded."""
    place = Pose(state.pose.x, -0.05, state.pose.pitch)
    return replace(state, pose=place, commanded=place)


def hand(change: Callable[[HandState], HandState]) -> Injection:
    """Fault of the hand: its states pass through `change`."""

    def strike(scene: Scene) -> None:
        scene.cell.hand.reports = change

    return Injection(strike)


def silent_hand(scene: Scene) -> None:
    """Fault of the hand: it repeats its first state from now on."""
    scene.cell.hand.reports = _repeat_first(HandState)


def stuck_hand(scene: Scene) -> None:
    """Fault of the hand: the fingers stand still, but are reported as moving."""
    scene.cell.hand.deaf = True
    scene.cell.hand.reports = lambda state: replace(state, moving=True)


def decides(otherwise: Callable[[Decision], Decision]) -> Injection:
    """Fault of the policy: its decisions pass through `otherwise`."""

    def strike(scene: Scene) -> None:
        scene.policy.otherwise = otherwise

    return Injection(strike)


def without_number(decision: Decision) -> Decision:
    """Fault of the policy: a direction that is not a number."""
    return replace(decision, direction=np.full_like(decision.direction, math.nan))


def hanging(_: Decision) -> Decision:
    """Fault of the policy: its decision never returns."""
    while True:
        time.sleep(0.01)


def full_disk(_: Scene) -> None:
    """Fault of the machine: files take no more bytes, as on a full disk."""
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (DISK_ROOM, hard))


def pause(scene: Scene, seconds: float) -> None:
    """Fault of the record: a write to its disk takes `seconds` while the cell's clock goes on."""
    scene.cell.clock.wait_until(scene.cell.clock.now() + seconds)


def dying_viewer(_: Scene) -> None:
    """Fault of an observer: the viewer raises a RuntimeError."""
    raise RuntimeError("the viewer died")


def jump(by: float) -> Injection:
    """Fault of the cell's clock: it jumps `by` [s] against the devices' clock."""

    def strike(scene: Scene) -> None:
        scene.cell.clock.jump = by

    return Injection(strike)


def send(number: signal.Signals) -> Injection:
    """Fault of the machine: this process receives the signal `number`."""
    return Injection(lambda _: os.kill(os.getpid(), number))


def suffers(**facts: object) -> Injection:
    """Fault of the emulated robot, with the `facts` of an entry of its fault script."""
    return Injection(lambda scene: scene.cell.strike_robot(**facts), "fci")


FAULTS: Mapping[str, Injection] = {
    "camera: frozen": camera(failing.freeze),
    "camera: silent": camera(failing.lose_all),
    "camera: nine of ten lost": camera(failing.lose_most),
    "camera: 0.4 s late": Injection(lambda s: _make_devices_late(s, 0.4)),
    "camera: moved by 2 mm": Injection(moved_camera),
    "camera: a quarter of the light": camera(failing.darken),
    "camera: four times the light": camera(failing.overexpose),
    "camera: other white balance": camera(failing.tint),
    "camera: half of it noise": camera(failing.corrupt),
    "camera: JPEG with padding": camera(failing.jpeg(holes=False)),
    "camera: JPEG with holes": camera(failing.jpeg(holes=True)),
    "arm: stale state": Injection(stale),
    "arm: no number": reports(lambda s: replace(s, pose=Pose(math.nan, math.nan, math.nan))),
    "arm: lags": Injection(lagging),
    "arm: refuses": Injection(refusing),
    "arm: setpoints lost": Injection(deaf),
    "arm: overspeed": reports(lambda s: replace(s, velocity=Velocity(0.5, 0.0, 0.0))),
    "arm: out of the box": reports(beside),
    "arm: force offset": reports(lambda s: replace(s, force=(HOLLOW, 0.0))),
    "robot: reflex": suffers(kind="reflex"),
    "robot: user stop": suffers(kind="user_stop"),
    "robot: link lost": suffers(kind="tcp_drop"),
    "robot: silent 0.7 s": suffers(kind="freeze", duration=0.7),
    "robot: silent 1.5 s": suffers(kind="freeze", duration=1.5),
    "robot: no number": suffers(kind="nan", ticks=3),
    "robot: load of 2 kg": suffers(kind="contact", force=(0.0, 0.0, -19.6)),
    "robot: push of 20 N": suffers(kind="contact", force=(0.0, 0.0, 20.0)),
    "robot: cell silent for 1 s": Injection(lambda s: pause(s, 1.0), "fci"),
    "robot: driver killed": Injection(lambda s: s.cell.kill_driver(), "fci"),
    "hand: strip slips out": Injection(lambda s: s.cell.drop_strip()),
    "hand: width 0": hand(lambda s: replace(s, width=0.0, grasped=False)),
    "hand: silent": Injection(silent_hand),
    "hand: stuck": Injection(stuck_hand),
    "policy: no number": decides(without_number),
    "policy: hangs": decides(hanging),
    "record: disk full": Injection(full_disk, spares=False),
    "record: 0.2 s slow": Injection(lambda s: pause(s, 0.2)),
    "viewer: dies": Injection(dying_viewer),
    "clock: 1 s ahead": jump(1.0),
    "clock: 1 s back": jump(-1.0),
    "twin: diverges": Injection(lambda s: s.cell.diverge()),
    "signal: interrupt": send(signal.SIGINT),
    "signal: terminate": send(signal.SIGTERM),
    "signal: hang up": send(signal.SIGHUP),
}


def _make_devices_late(scene: Scene, by: float) -> None:
    scene.cell.camera.spoil = failing.delay(by)
