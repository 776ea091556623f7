"""Faults of the campaign by name, each with the injection that changes a running
cell.
"""

import math
import os
import resource
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from drivers.base.errors import Fault
from drivers.base.types import ArmState, Pose, Velocity
from policies.policy import Decision
from tests.lab.faults import failing
from tests.lab.faults.failing import Failing, FailingPolicy

HOLLOW = 60.0  # N of a false reading
DISK_ROOM = 4096  # bytes that a full disk still takes in a file
LONGEST_TICK = 0.02  # s between two velocities, of which a lagging arm takes account


@dataclass(frozen=True, slots=True)
class Scene:
    """Devices and policy of one fold that can fail; `moved` [px] is the image shift of
    2 mm.
    """

    cell: Failing
    policy: FailingPolicy
    moved: tuple[float, float]


Strike = Callable[[Scene], None]


@dataclass(frozen=True, slots=True)
class Injection:
    """Fault to `strike` with, the `arm` that can suffer it, and whether it `spares` the
    record.
    """

    strike: Strike
    arm: str = "twin"
    spares: bool = True


def switch(path: str, value: Any) -> Injection:
    """Fault that sets the switch at `path` of the scene, as `cell.camera.spoil`, to
    `value`.
    """
    owner, _, name = path.rpartition(".")
    return Injection(lambda scene: setattr(attrgetter(owner)(scene), name, value))


camera = partial(switch, "cell.camera.spoil")
arm = partial(switch, "cell.arm.reports")
hand = partial(switch, "cell.hand.reports")
policy = partial(switch, "policy.otherwise")


def repeats(path: str) -> Injection:
    """Fault of a device that repeats for ever the next state that passes through
    `path`.
    """

    def strike(scene: Scene) -> None:
        first: dict[str, Any] = {}
        switch(path, lambda state: first.setdefault("state", state)).strike(scene)

    return Injection(strike)


def moved_camera(scene: Scene) -> None:
    """Fault of the camera: a nudge shifts the image by 2 mm along the desk."""
    scene.cell.camera.spoil = failing.shift(scene.moved)


def late_camera(scene: Scene) -> None:
    """Fault of the camera: its images are 0.4 s late."""
    scene.cell.camera.spoil = failing.delay(0.4)


@dataclass(slots=True)
class _Lag:
    """Arm that moves at half of each velocity, and reports the pose that was
    commanded.
    """

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
        return replace(
            state, commanded=replace(due, x=due.x + self.lost_x, z=due.z + self.lost_z)
        )


def lagging(scene: Scene) -> None:
    """Fault of the arm: it follows at half of each velocity, and reports the commanded
    pose.
    """
    lag = _Lag(scene.cell.clock.now)
    scene.cell.arm.follows, scene.cell.arm.reports = lag.follow, lag.report


def beside(state: ArmState) -> ArmState:
    """Fault of the arm: it reports a pose outside its workspace, measured and
    commanded.
    """
    place = Pose(state.pose.x, -0.05, state.pose.pitch)
    return replace(state, pose=place, commanded=place)


def stuck_hand(scene: Scene) -> None:
    """Fault of the hand: the fingers stand still, but are reported as moving."""
    scene.cell.hand.deaf = True
    scene.cell.hand.reports = lambda state: replace(state, moving=True)


def without_number(decision: Decision) -> Decision:
    """Fault of the policy: a direction that is not a number."""
    return decision._replace(direction=np.full_like(decision.direction, math.nan))


def hanging(_: Decision) -> Decision:
    """Fault of the policy: its decision never returns."""
    while True:
        time.sleep(0.01)


def full_disk(_: Scene) -> None:
    """Fault of the machine: files take no more bytes, as on a full disk."""
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (DISK_ROOM, hard))


def pause(scene: Scene, seconds: float) -> None:
    """Fault of the record: a write to its disk takes `seconds` while the cell's clock
    goes on.
    """
    clock = scene.cell.clock
    clock.wait_until(clock.now() + seconds)


def dying_viewer(_: Scene) -> None:
    """Fault of an observer: the viewer raises a RuntimeError."""
    raise RuntimeError("the viewer died")


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
    "camera: 0.4 s late": Injection(late_camera),
    "camera: moved by 2 mm": Injection(moved_camera),
    "camera: a quarter of the light": camera(failing.darken),
    "camera: four times the light": camera(failing.overexpose),
    "camera: other white balance": camera(failing.tint),
    "camera: half of it noise": camera(failing.corrupt),
    "camera: JPEG with padding": camera(failing.jpeg(holes=False)),
    "camera: JPEG with holes": camera(failing.jpeg(holes=True)),
    "arm: stale state": repeats("cell.arm.reports"),
    "arm: no number": arm(
        lambda s: replace(s, pose=Pose(math.nan, math.nan, math.nan))
    ),
    "arm: lags": Injection(lagging),
    "arm: refuses": switch(
        "cell.arm.refusal", Fault("motion_refused", "the robot refuses the command")
    ),
    "arm: setpoints lost": switch("cell.arm.follows", lambda _: None),
    "arm: overspeed": arm(lambda s: replace(s, velocity=Velocity(0.5, 0.0, 0.0))),
    "arm: out of the box": arm(beside),
    "arm: force offset": arm(lambda s: replace(s, force=(HOLLOW, 0.0))),
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
    "hand: silent": repeats("cell.hand.reports"),
    "hand: stuck": Injection(stuck_hand),
    "policy: no number": policy(without_number),
    "policy: hangs": policy(hanging),
    "record: disk full": Injection(full_disk, spares=False),
    "record: 0.2 s slow": Injection(lambda s: pause(s, 0.2)),
    "viewer: dies": Injection(dying_viewer),
    "clock: 1 s ahead": switch("cell.clock.jump", 1.0),
    "clock: 1 s back": switch("cell.clock.jump", -1.0),
    "twin: diverges": Injection(lambda s: s.cell.diverge()),
    "signal: interrupt": send(signal.SIGINT),
    "signal: terminate": send(signal.SIGTERM),
    "signal: hang up": send(signal.SIGHUP),
}
