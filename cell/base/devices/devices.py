"""Devices of a cell as the fold's control uses them, and the trial for which they are
opened.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from calibration.wizard.coverage import WantedView
from drivers.base.geometry import interpolate_columns
from drivers.base.protocols import Arm, Camera, Clock, Hand
from drivers.base.types import ArmState, Array, Frame, Pose, frozen
from drivers.strip.file import StripFile

STATES_KEPT = 256  # of the arm, for the gripper's pose at an earlier moment


class Closable(Protocol):
    """Protocol of a resource that must be closed at the end."""

    def close(self) -> None:
        """Release the resources; calling it twice is allowed."""


class CalibrationAids(Protocol):
    """Protocol of the twin's calibration aids, which move the board and the pointer
    that a person would hold.
    """

    def show_board(self, wanted: WantedView) -> Frame:
        """Take an image of the calibration board, held so that it appears in the image
        as `wanted` states.
        """

    def hold_pointer(self, held: bool) -> None:
        """Put the pointer between the fingers if `held` is true, else remove it."""


@dataclass(frozen=True, slots=True)
class Devices:
    """Devices of an open cell: clock, arm, hand and camera, and on the twin the strip's
    true state, `plant`.

    A calibration must match `camera_identity`.
    `camera_locks` states the values to which the camera controls are locked, `others`
    are what else must be closed at the end. Once closed, `arm_timing` states how evenly
    the states of a free-running arm came, and `arm_joints` a robot's joints at every
    tick, rows (n, 29) as
    `drivers.franka.joint_log` keeps them on the clock's time. In `real_time` the clock
    is the wall's, and waits for nobody.
    """

    clock: Clock
    arm: Arm
    hand: Hand
    camera: Camera
    camera_identity: str
    aids: CalibrationAids | None
    plant: "GroundTruth | None"
    camera_locks: Callable[[], Mapping[str, int]] = dict
    others: tuple[Closable, ...] = ()
    arm_timing: Callable[[], Mapping[str, Any]] = dict
    arm_joints: Callable[[], Array] = lambda: frozen([])
    real_time: bool = False

    def connect(self) -> None:
        """Connect to the arm and to the camera."""
        self.arm.connect()
        self.camera.connect()

    def close(self) -> None:
        """Bring the arm to rest and close all devices, even where one fails to
        close.
        """
        with ExitStack() as left:
            for device in (*reversed(self.others), self.camera, self.arm):
                left.callback(device.close)


class ArmHistory:
    """History of the newest measured states of the arm, STATES_KEPT of them, for its
    pose at a past time.
    """

    def __init__(self) -> None:
        self._states: deque[ArmState] = deque(maxlen=STATES_KEPT)

    def add(self, state: ArmState) -> None:
        """Append the newest measured state of the arm to the history."""
        self._states.append(state)

    def pose_at(self, stamp: float) -> Pose:
        """Gripper pose at `stamp` [s], interpolated between measured states of the
        arm.
        """
        states = self._states
        last = len(states) - 1
        after = bisect_right(
            states, stamp, 1, max(last, 1), key=lambda state: state.stamp
        )
        pair = (states[after - 1], states[min(after, last)])
        times = [state.stamp for state in pair]
        poses = np.array([state.pose.as_array() for state in pair])
        return Pose.from_array(interpolate_columns(stamp, np.array(times), poses))


class GroundTruth(Protocol):
    """Protocol of a strip whose true motion is known; it serves only to score a run
    after its end.
    """

    def truth(self, origin: float, goal: float = 0.0) -> Mapping[str, Any]:
        """True time of touch [s] since `origin`, displacement and edge offset [m], by
        name; None for what did not happen.

        The lengths are those of a fold whose grasped edge is to lie at x = `goal` [m].
        """


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial of a cell: the strip and the run that the twin simulates, and the
    operator's consent.

    The `plant` lies on the twin's desk instead of the strip. `index` is the number of
    runs that the strip on the desk has already been through; `agreed` whether an
    operator has agreed that a real robot moves.
    """

    plant: StripFile | None = None
    seed: int = 0
    index: int = 0
    agreed: bool = False
