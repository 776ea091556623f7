"""Simulated arm, a servo with tracking lag and noise, and simulated hand of two
fingers.
"""

from collections import deque
from functools import partial
from math import hypot, nan

import numpy as np

from drivers.base.errors import Fault
from drivers.base.installation import Installation
from drivers.base.motion import TICK, MotionProfile, lag_gain
from drivers.base.types import ArmState, Array, HandState, Pose, Velocity
from drivers.twin.clock import Rank, TimedCall, TwinClock
from drivers.twin.settings import ArmSettings, HandSettings, WrenchSettings
from drivers.twin.world import Fingers, World

ARM_SOURCE, HAND_SOURCE = "twin arm", "twin hand"
SETTLED_DISTANCE = 1e-5  # m or rad behind the command at which a motion has ended
NOISE_BLOCK = 1024  # ticks of noise drawn together
FORCE_NOT_MEASURED = (nan, nan)


class ExternalWrench:
    """Sensor of the external force on the simulated arm: `reading` (f_x, f_z) [N], in
    the cell.

    An arm estimates the force from the torques of its motors, averaged over some time;
    an error of its tare stays for the session.
    """

    def __init__(self, settings: WrenchSettings, rng: np.random.Generator) -> None:
        """Force sensor that reads zero at first; draws noise and offset from `rng`."""
        self._rng = rng
        self._noise = settings.noise
        self._lag_gain = lag_gain(settings.lag)
        self._offset = settings.bias * rng.standard_normal(2)
        self._average = np.zeros(2)
        self.reading = (0.0, 0.0)

    def tick(self, force: tuple[float, float]) -> None:
        """Update the force reading from the true `force` (f_x, f_z) [N]: lag, offset,
        noise.
        """
        self._average += self._lag_gain * (np.array(force) - self._average)
        noise = self._noise * self._rng.standard_normal(2)
        x, z = (self._average + self._offset + noise).tolist()
        self.reading = (x, z)


class TwinArm:
    """Simulated arm, whose servo advances a thousand times per second of simulated
    time.

    Commands and measurements are converted to the robot's base and back, as on
    hardware. The servo runs from construction and holds the arm still until it is
    connected. The arm reports a pose by the delay of the world's rig late; with a
    negative delay the gripper arrives later than reported. Force is reported where the
    settings say so.
    """

    def __init__(
        self,
        world: World,
        clock: TwinClock,
        settings: ArmSettings,
        installation: Installation,
        rng: np.random.Generator,
    ) -> None:
        """Arm at rest at the gripper of `world`, its servo run by `clock`; noise from
        `rng`.
        """
        start = world.gripper
        self._world = world
        self._clock = clock
        self._rng = rng
        self._delay = world.model.rig.delay
        self._cell_in_robot = installation.mounting.transform()
        self._connected = self._closed = False
        self._profile = MotionProfile(
            installation.limits, installation.workspace, start
        )
        self._lag_gain = lag_gain(settings.lag)
        self._position = [*start]
        self._velocity = [0.0, 0.0, 0.0]
        at_rest = (*self._position, *self._velocity)
        self._history = deque(
            [at_rest] * (2 + int(max(self._delay, 0.0) / TICK))
        )  # the newest last
        self._ticks = 0
        self._stamp = clock.now()
        self._sigma = np.array([*3 * [settings.noise], settings.pitch_noise])
        self._noise = rng.standard_normal((NOISE_BLOCK, 4))
        wrench = settings.force
        # from a separate generator, so that other noise does not depend on it
        self._wrench = (
            None if wrench is None else ExternalWrench(wrench, rng.spawn(1)[0])
        )
        clock.every(TICK, self._tick, Rank.SERVO)

    def connect(self) -> None:
        """Connect to the arm and hold it at rest; may be called again, raises Fault
        once closed.
        """
        self._require_open()
        self._connected = True

    def state(self) -> ArmState:
        """State of the arm that the servo measured when it last advanced,
        every 1 ms.
        """
        profile = self._profile
        self._require_connection()
        return ArmState(
            stamp=self._stamp,
            arrival=self._clock.now(),
            source=ARM_SOURCE,
            pose=self._measure(),
            velocity=Velocity(*self._report()[3:]),
            commanded=profile.pose,
            moving=profile.moving or not self._settled,
            expired=profile.expired,
            force=FORCE_NOT_MEASURED if self._wrench is None else self._wrench.reading,
        )

    def move_to(self, pose: Pose) -> None:
        """Start a motion to rest at `pose`; Fault `outside_workspace` for a pose
        outside of it.
        """
        self._require_connection()
        self._profile.move_to(pose)

    def set_velocity(self, velocity: Velocity) -> None:
        """Move the gripper at `velocity`; Fault `velocity_refused` for one above the
        limits.
        """
        self._require_connection()
        self._profile.set_velocity(velocity)

    def stop(self) -> None:
        """Brake the arm to rest within its limits; allowed at any time."""
        self._profile.stop()

    def close(self) -> None:
        """Brake the arm and disconnect; may be called again. The servo finishes braking
        afterwards.
        """
        self._profile.stop()
        self._connected = False
        self._closed = True

    def _tick(self, time: float) -> None:
        """Advance the servo by 1 ms to `time` [s], and give the simulated world the new
        pose.
        """
        self._stamp = time
        self._ticks += 1
        if self._ticks % NOISE_BLOCK == 0:
            self._noise = self._rng.standard_normal((NOISE_BLOCK, 4))
        if self._wrench is not None:
            self._wrench.tick(self._world.grip_force)

        self._trail(self._profile.tick())
        self._history.append((*self._position, *self._velocity))
        self._history.popleft()
        arrives = time - min(self._delay, 0.0)
        self._world.add_pose(arrives, partial(self._in_cell, self._position))

    def _in_cell(self, position: list[float]) -> Pose:
        """Gripper pose at `position` (x [m], z [m], pitch [rad]), after conversion to
        the robot's base and back.
        """
        return Pose(
            *self._cell_in_robot.to_cell(self._cell_in_robot.to_robot(*position))
        )

    def _trail(self, command: list[float]) -> None:
        """Move the arm's position towards `command` (x, z, pitch) with a first-order
        lag.
        """
        lags = zip(command, self._position, strict=True)
        step = [self._lag_gain * (goal - actual) for goal, actual in lags]
        self._position = [
            actual + move for actual, move in zip(self._position, step, strict=True)
        ]
        self._velocity = [move / TICK for move in step]

    def _report(self) -> list[float]:
        """Pose and velocity (6,) that the arm reports now: those of `delay` [s] ago."""
        ticks = max(self._delay, 0.0) / TICK
        full_ticks = int(ticks)
        share = ticks - full_ticks
        newer = self._history[-1 - full_ticks]
        older = self._history[-2 - full_ticks]
        return [
            new + share * (old - new) for new, old in zip(newer, older, strict=True)
        ]

    @property
    def _settled(self) -> bool:
        commanded = self._profile.pose
        x, z, pitch, *_ = self._report()
        behind = hypot(commanded.x - x, commanded.z - z, commanded.pitch - pitch)
        return behind <= SETTLED_DISTANCE

    def _measure(self) -> Pose:
        """Gripper pose with the robot's measurement noise, in the cell frame."""
        noise: Array = self._noise[self._ticks % NOISE_BLOCK] * self._sigma
        x, z, pitch, *_ = self._report()
        pose = self._cell_in_robot.to_robot(x, z, pitch + noise[3])
        pose[:3, 3] += noise[:3]
        return Pose(*self._cell_in_robot.to_cell(pose))

    def _require_open(self) -> None:
        if self._closed:
            raise Fault("arm_closed", "the arm was let go; open the cell again")

    def _require_connection(self) -> None:
        self._require_open()
        if not self._connected:
            raise Fault(
                "arm_not_connected", "the arm is not connected; connect it first"
            )


class TwinHand:
    """Simulated hand, whose grasp holds the strip if its edge lies between the
    fingers.
    """

    def __init__(self, world: World, clock: TwinClock, settings: HandSettings) -> None:
        """Open hand over the strip of `world`."""
        self._world = world
        self._clock = clock
        self._settings = settings
        self._fingers = Fingers(
            settings.opening, settings.opening, start=clock.now(), speed=settings.speed
        )
        self._closing: TimedCall | None = None
        world.move_fingers(self._fingers)

    def open(self, width: float | None = None) -> None:
        """Start to open the fingers, to `width` [m] or as wide as they go; a held strip
        is released immediately.
        """
        self._world.detach()
        self._move(self._settings.opening if width is None else width)

    def grasp(self) -> None:
        """Start to close the fingers on the strip's edge; does nothing while they hold
        it.
        """
        if self._world.holds_strip:
            return
        self._move(0.0)
        meeting = self._fingers.width - self._world.model.mechanics.thickness
        if meeting >= 0:
            time = self._fingers.start + meeting / self._settings.speed
            self._closing = self._clock.at(time, self._meet_strip, Rank.HAND)

    def state(self) -> HandState:
        """State of the fingers now: width, whether they hold the strip, whether they
        move.
        """
        time = self._clock.now()
        return HandState(
            stamp=time,
            arrival=time,
            source=HAND_SOURCE,
            width=self._fingers.at(time),
            grasped=self._world.holds_strip,
            moving=time < self._fingers.end,
        )

    def stop(self) -> None:
        """Stop the fingers' motion; a strip that they hold stays held."""
        self._move(self._fingers.at(self._clock.now()))

    def _move(self, target: float) -> None:
        """Replace the fingers' motion by one to the width `target` [m]."""
        if self._closing is not None:
            self._closing.cancel()
            self._closing = None
        time = self._clock.now()
        width = self._fingers.at(time)
        self._fingers = Fingers(width, target, start=time, speed=self._settings.speed)
        self._world.move_fingers(self._fingers)

    def _meet_strip(self, _: float) -> None:
        """Grasp the strip if its edge lies between the fingers, which have closed to
        it.
        """
        world = self._world
        if world.edge_within(self._settings.reach, self._settings.lean):
            world.attach()
            self._move(world.model.mechanics.thickness)
