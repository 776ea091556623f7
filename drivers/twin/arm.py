"""The twin's arm: a simulated servo with tracking lag and measurement noise."""

from collections import deque
from functools import partial
from math import exp, hypot

import numpy as np

from drivers.errors import Fault
from drivers.installation import Installation
from drivers.motion import TICK, MotionProfile
from drivers.twin.clock import Rank, TwinClock
from drivers.twin.settings import ArmSettings, WrenchSettings
from drivers.twin.world import World
from drivers.types import ArmState, Array, Pose, Velocity

SOURCE = "twin arm"
SETTLED_DISTANCE = 1e-5  # m or rad behind the command at which a motion has ended
NOISE_BLOCK = 1024  # ticks of noise drawn together
FORCE_NOT_MEASURED = (float("nan"), float("nan"))


class ExternalWrench:
    """Simulated external force of the twin's arm, in the plane of the strip.

    An arm estimates it from the torques of its motors, averaged over some time; what its tare did
    not take off stays for the session.
    """

    def __init__(self, settings: WrenchSettings, rng: np.random.Generator) -> None:
        """Start at zero force; noise and offset come from `rng`."""
        self._rng = rng
        self._noise = settings.noise
        self._share = 1.0 if settings.lag == 0 else 1.0 - exp(-TICK / settings.lag)
        self._offset = settings.bias * rng.standard_normal(2)
        self._average = np.zeros(2)
        self._reading = (0.0, 0.0)

    def tick(self, force: tuple[float, float]) -> None:
        """Update the reading from the true `force` (f_x, f_z) [N], with lag, offset and noise."""
        self._average += self._share * (np.array(force) - self._average)
        noise = self._noise * self._rng.standard_normal(2)
        x, z = (self._average + self._offset + noise).tolist()
        self._reading = (x, z)

    @property
    def reading(self) -> tuple[float, float]:
        """Reported force (f_x, f_z) [N]."""
        return self._reading


class TwinArm:
    """A simulated robot on its mounting, whose servo ticks at 1 kHz of simulated time.

    Commands and measurements pass through the robot's own frame, as on hardware. The servo runs
    from construction and holds the arm still until it is connected. The arm reports a pose `delay`
    [s] after it was there; with a negative delay the gripper arrives later than reported. Force is
    reported where the settings say so.
    """

    def __init__(
        self,
        world: World,
        clock: TwinClock,
        settings: ArmSettings,
        installation: Installation,
        rng: np.random.Generator,
        delay: float = 0.0,
    ) -> None:
        """An arm at rest at the gripper of `world`, with noise from `rng`."""
        start = world.gripper
        self._world = world
        self._clock = clock
        self._rng = rng
        self._cell_in_robot = installation.mounting.transform()
        self._profile = MotionProfile(installation.limits, installation.workspace, start)
        self._follow = 1.0 if settings.lag == 0 else 1.0 - exp(-TICK / settings.lag)
        self._sigma = np.array([*3 * [settings.noise], settings.pitch_noise])
        self._noise = self._rng.standard_normal((NOISE_BLOCK, 4))
        self._ticks = 0
        self._stamp = clock.now()
        self._actual = [start.x, start.z, start.pitch]
        self._rate = [0.0, 0.0, 0.0]
        self._delay = delay
        wrench = settings.force  # from a separate generator: other noise stays the same
        self._wrench = None if wrench is None else ExternalWrench(wrench, rng.spawn(1)[0])
        still = (*self._actual, *self._rate)
        self._past = deque([still] * (2 + int(max(delay, 0.0) / TICK)))
        self._connected = False
        self._closed = False
        clock.every(TICK, self._tick, Rank.SERVO)

    def connect(self) -> None:
        """Connect and hold the arm at rest; allowed twice, refused once closed."""
        if self._closed:
            raise Fault("arm_closed", "the arm was let go; open the cell again")
        self._connected = True

    def state(self) -> ArmState:
        """The state that the servo measured at its newest tick."""
        self._require_connection()
        return ArmState(
            stamp=self._stamp,
            arrival=self._clock.now(),
            source=SOURCE,
            pose=self._measure(),
            velocity=Velocity(*self._report()[3:]),
            commanded=self._profile.pose,
            moving=self._profile.moving or not self._settled,
            expired=self._profile.expired,
            force=FORCE_NOT_MEASURED if self._wrench is None else self._wrench.reading,
        )

    def move_to(self, pose: Pose) -> None:
        """Start a motion to rest at `pose`; Fault `outside_workspace` when it is out of reach."""
        self._require_connection()
        self._profile.move_to(pose)

    def set_velocity(self, velocity: Velocity) -> None:
        """Follow `velocity`; Fault `velocity_refused` above the limits."""
        self._require_connection()
        self._profile.set_velocity(velocity)

    def stop(self) -> None:
        """Brake within the limits; allowed at any time, from any state."""
        self._profile.stop()

    def close(self) -> None:
        """Brake and disconnect; allowed twice. The servo finishes braking afterwards."""
        self._profile.stop()
        self._connected = False
        self._closed = True

    def _tick(self, now: float) -> None:
        self._stamp = now
        self._ticks += 1
        if self._ticks % NOISE_BLOCK == 0:
            self._noise = self._rng.standard_normal((NOISE_BLOCK, 4))
        if self._wrench is not None:
            self._wrench.tick(self._world.grip_force)
        self._trail(self._profile.tick())
        self._past.append((*self._actual, *self._rate))
        self._past.popleft()
        arrives = now - min(self._delay, 0.0)
        self._world.follow_when_asked(arrives, partial(self._in_cell, self._actual))

    def _in_cell(self, actual: list[float]) -> Pose:
        """Pose of `actual` (x, z, pitch) after the conversion to the robot's frame and back."""
        return Pose(*self._cell_in_robot.to_cell(self._cell_in_robot.to_robot(*actual)))

    def _trail(self, command: list[float]) -> None:
        """Move the actual pose towards `command` (x, z, pitch) with a first-order lag."""
        lags = zip(command, self._actual, strict=True)
        step = [self._follow * (goal - actual) for goal, actual in lags]
        self._actual = [actual + move for actual, move in zip(self._actual, step, strict=True)]
        self._rate = [move / TICK for move in step]

    def _report(self) -> list[float]:
        """Pose and rate (6,) that the arm reports now: those of `delay` [s] ago."""
        ticks = max(self._delay, 0.0) / TICK
        whole = int(ticks)
        share = ticks - whole
        newer, older = self._past[-1 - whole], self._past[-2 - whole]
        return [new + share * (old - new) for new, old in zip(newer, older, strict=True)]

    @property
    def _settled(self) -> bool:
        commanded = self._profile.pose
        x, z, pitch, *_ = self._report()
        behind = hypot(commanded.x - x, commanded.z - z, commanded.pitch - pitch)
        return behind <= SETTLED_DISTANCE

    def _measure(self) -> Pose:
        """The robot's measurement, transformed to the cell frame."""
        noise: Array = self._noise[self._ticks % NOISE_BLOCK] * self._sigma
        x, z, pitch, *_ = self._report()
        pose = self._cell_in_robot.to_robot(x, z, pitch + noise[3])
        pose[:3, 3] += noise[:3]
        return Pose(*self._cell_in_robot.to_cell(pose))

    def _require_connection(self) -> None:
        if self._closed:
            raise Fault("arm_closed", "the arm was let go; open the cell again")
        if not self._connected:
            raise Fault("arm_not_connected", "the arm is not connected; connect it first")
