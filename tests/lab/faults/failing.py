"""Wrappers of devices and policy that inject faults, for the campaign of faults."""

import os
import signal
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from cell.base.devices.devices import Devices
from cell.base.devices.twin import TwinPlant
from drivers.base.errors import ConfigurationError, Fault, SimulationNotFinite
from drivers.base.protocols import Arm, Hand
from drivers.base.settings import parse
from drivers.base.types import ArmState, Frame, HandState, Pose, Velocity
from drivers.twin.clock import Rank
from drivers.twin.fci_server.faults import FaultScript
from drivers.twin.fci_server.server import RobotServer
from drivers.v4l2.formats import JPEG_END, PictureFormat
from policies.policy import Decision, Observation, Policy

PERIOD = 0.002  # s between two looks at the gripper
Spoil = Callable[[Frame, Frame], Frame | None]
"""Function from a frame and the last good one to the frame delivered, None if it is
lost.
"""


class Delegate:
    """Wrapper of a device or policy that forwards all that a subclass does not
    override.
    """

    def __init__(self, device: Any) -> None:
        self._device = device

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)


class FailingCamera(Delegate):
    """A camera whose frames pass through the fault `spoil` once that is set."""

    spoil: Spoil | None = None
    _kept: Frame | None = None

    def read(self, after: float, timeout: float) -> Frame | None:
        """The newest frame as the fault alters it, or None."""
        frame: Frame | None = self._device.read(after, timeout)
        if frame is None or self.spoil is None:
            self._kept = frame or self._kept
            return frame
        spoilt = self.spoil(frame, self._kept or frame)
        return None if spoilt is None or spoilt.stamp <= after else spoilt


class FailingArm(Delegate):
    """Arm whose states and commands faults alter, or which refuses commands.

    No fault of the campaign prevents its stop.
    """

    def __init__(self, arm: Arm) -> None:
        super().__init__(arm)
        self.reports: Callable[[ArmState], ArmState] = lambda state: state
        self.follows: Callable[[Velocity], Velocity | None] = lambda velocity: velocity
        self.refusal: Fault | None = None

    def state(self) -> ArmState:
        """The newest state as the fault alters it."""
        return self.reports(self._device.state())

    def move_to(self, pose: Pose) -> None:
        """Start a motion, unless commands are refused."""
        self._refuse_if_failing()
        self._device.move_to(pose)

    def set_velocity(self, velocity: Velocity) -> None:
        """Follow `velocity` as the fault alters it."""
        self._refuse_if_failing()
        kept = self.follows(velocity)
        if kept is not None:
            self._device.set_velocity(kept)

    def _refuse_if_failing(self) -> None:
        if self.refusal is not None:
            raise self.refusal


class FailingHand(Delegate):
    """Hand whose states a fault alters, or which ignores commands (`deaf`)."""

    def __init__(self, hand: Hand) -> None:
        super().__init__(hand)
        self.reports: Callable[[HandState], HandState] = lambda state: state
        self.deaf = False

    def open(self, width: float | None = None) -> None:
        """Start to open the fingers, unless the hand is deaf."""
        if not self.deaf:
            self._device.open(width)

    def grasp(self) -> None:
        """Start to close the fingers, unless the hand is deaf."""
        if not self.deaf:
            self._device.grasp()

    def state(self) -> HandState:
        """The newest state as the fault alters it."""
        return self.reports(self._device.state())


class FailingClock(Delegate):
    """A clock that is `jump` [s] ahead of the devices' clock."""

    jump = 0.0

    def now(self) -> float:
        """Seconds since the run began, plus the jump."""
        return float(self._device.now()) + self.jump

    def wait_until(self, time: float) -> None:
        """Return when `time` has come by this clock."""
        self._device.wait_until(time - self.jump)


class FailingPolicy(Delegate):
    """A policy whose decisions pass through `otherwise` once that is set."""

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy)
        self.otherwise: Callable[[Decision], Decision] = lambda decision: decision

    def decide(self, observation: Observation) -> Decision:
        """Decision of the policy as the fault alters it."""
        return self.otherwise(self._device.decide(observation))


class Failing:
    """Fault switches on the devices of a twin, off at first, and the true gripper
    motion.

    `motion` holds rows of time [s], x, z [m], pitch [rad], one every `PERIOD`.
    """

    def __init__(self, devices: Devices) -> None:
        """Wrap the devices of a twin; raises ConfigurationError for other `devices`."""
        if not isinstance(devices.plant, TwinPlant):
            raise ConfigurationError(
                "faults: are injected into a twin only; use arm twin or fci"
            )
        self._twin, self._others = devices.plant.twin, devices.others
        self._driver = devices.arm
        self.camera = FailingCamera(devices.camera)
        self.arm = FailingArm(devices.arm)
        self.hand = FailingHand(devices.hand)
        self.clock = FailingClock(devices.clock)
        self.motion: list[tuple[float, float, float, float]] = []
        self._twin.clock.every(PERIOD, self._record_pose, Rank.JOB)
        wrapped: dict[str, Any] = {
            "camera": self.camera,
            "arm": self.arm,
            "hand": self.hand,
            "clock": self.clock,
        }
        self.devices = replace(devices, **wrapped)

    @property
    def now(self) -> float:
        """Seconds of the simulated world, whatever the cell's clock says."""
        return self._twin.clock.now()

    def strike_robot(self, **facts: object) -> None:
        """Make the emulated robot suffer a fault at its next tick; `facts` as in a
        fault script.
        """
        script = parse(
            {"schema": 1, "faults": [{"at": 0, **facts}]}, FaultScript, "faults"
        )
        for other in self._others:
            if isinstance(other, RobotServer):
                other.inject(script.faults[0])

    def kill_driver(self) -> None:
        """Kill the process that owns the robot."""
        child: Any = getattr(self._driver, "_child", None)
        if child is not None:
            os.kill(child.pid, signal.SIGKILL)

    def drop_strip(self) -> None:
        """Let the strip slip out of the fingers."""
        self._twin.world.detach()

    def diverge(self) -> None:
        """Make the simulated strip diverge: the clock raises SimulationNotFinite."""

        def raises(now: float) -> None:
            raise SimulationNotFinite("chain", now)

        self._twin.clock.every(PERIOD, raises, Rank.WORLD)

    def look(self) -> None:
        """Record the gripper's present pose, missed by the clock when an event
        interrupts it.
        """
        if self.motion and self.now > self.motion[-1][0]:
            self._record_pose(self.now)

    def _record_pose(self, now: float) -> None:
        pose = self._twin.world.gripper
        self.motion.append((now, pose.x, pose.z, pose.pitch))


def freeze(frame: Frame, kept: Frame) -> Frame:
    """Fault of the camera: repeats the last good image."""
    return replace(frame, image=kept.image)


def lose_all(_frame: Frame, _kept: Frame) -> None:
    """Fault of the camera: loses all images."""


def lose_most(frame: Frame, _kept: Frame) -> Frame | None:
    """Fault of the camera: loses nine images of ten."""
    return frame if frame.sequence % 10 == 0 else None


def darken(frame: Frame, _kept: Frame) -> Frame:
    """Fault of the camera: another exposure, with a quarter of the light."""
    return replace(frame, image=frame.image // 4)


def overexpose(frame: Frame, _kept: Frame) -> Frame:
    """Fault of the camera: another exposure, with four times the light."""
    return replace(frame, image=cv2.convertScaleAbs(frame.image, alpha=4.0))


def tint(frame: Frame, _kept: Frame) -> Frame:
    """Fault of the camera: another white balance, as another program may set it."""
    gains = np.array([1.4, 1.0, 0.7])
    return replace(frame, image=np.clip(frame.image * gains, 0, 255).astype(np.uint8))


def corrupt(frame: Frame, kept: Frame) -> Frame:
    """Fault of the camera: the lower half of the image is noise."""
    image = kept.image.copy()
    half = image[len(image) // 2 :]
    half[:] = np.random.default_rng(frame.sequence).integers(
        0, 256, half.shape, np.uint8
    )
    return replace(frame, image=image)


def shift(by: tuple[float, float]) -> Spoil:
    """Fault of a camera that was moved: its image is shifted by `by` pixels."""
    warp = np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]]])

    def spoil(frame: Frame, _kept: Frame) -> Frame:
        h, w = frame.image.shape[:2]
        image = cv2.warpAffine(
            frame.image, warp, (w, h), borderMode=cv2.BORDER_REPLICATE
        )
        return replace(frame, image=np.asarray(image, np.uint8))

    return spoil


def delay(by: float) -> Spoil:
    """Fault of the camera: images arrive `by` [s] after their exposure; their stamps
    are right.
    """
    waiting: deque[Frame] = deque()

    def spoil(frame: Frame, _kept: Frame) -> Frame | None:
        waiting.append(frame)
        while len(waiting) > 1 and waiting[1].stamp <= frame.arrival - by:
            waiting.popleft()
        return waiting[0] if waiting[0].stamp <= frame.arrival - by else None

    return spoil


def jpeg(*, holes: bool) -> Spoil:
    """Fault of the camera: images are padded JPEG, with `holes` without a tenth of the
    bytes.

    The markers stay in place; the driver drops what is no picture.
    """

    def spoil(frame: Frame, _kept: Frame) -> Frame | None:
        h, w = frame.image.shape[:2]
        content = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, 95])[
            1
        ].tobytes()
        if holes:
            middle = len(content) // 2
            content = content[:middle] + content[middle + len(content) // 10 :]
        padded = content.removesuffix(JPEG_END) + JPEG_END + bytes(512)
        picture = PictureFormat("MJPG", w, h, 0, 0.0)
        image = picture.decode(np.frombuffer(padded, np.uint8))
        return None if image is None else replace(frame, image=image)

    return spoil
