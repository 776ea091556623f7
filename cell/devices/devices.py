"""The devices of a cell, as the orchestrator drives them."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from calibration.board_views import BoardPose
from drivers.protocols import Arm, Camera, Clock, Hand
from drivers.types import Frame


class Closable(Protocol):
    """Something that is let go in the end."""

    def close(self) -> None:
        """Let go; allowed twice."""
        ...


class CalibrationAids(Protocol):
    """What a calibration needs at hand. The twin has it; at a real cell a person brings it."""

    def show_board(self, pose: BoardPose) -> Frame:
        """An image of the calibration board held at `pose`."""
        ...

    def hold_pointer(self, held: bool) -> None:
        """Put the pointer between the fingers, or take it out."""
        ...


@dataclass(frozen=True, slots=True)
class Devices:
    """What the orchestrator drives. `camera_identity` is what a calibration must belong to.

    `others` is what else has to be let go in the end; `arm_timing` tells, once it is, how evenly
    the states of an arm came whose time runs by itself.
    """

    clock: Clock
    arm: Arm
    hand: Hand
    camera: Camera
    camera_identity: str
    aids: CalibrationAids | None
    plant: "Plant | None"
    others: tuple[Closable, ...] = ()
    arm_timing: Callable[[], Mapping[str, Any]] = dict

    def connect(self) -> None:
        """Take hold of arm and camera."""
        self.arm.connect()
        self.camera.connect()

    def close(self) -> None:
        """Bring the arm to rest and let go of everything, of the rest too where one refuses."""
        with ExitStack() as left:
            for device in (*reversed(self.others), self.camera, self.arm):
                left.callback(device.close)


class Plant(Protocol):
    """The twin's truth, for scoring a run after it ended and for nothing else."""

    def truth(self, origin: float) -> Mapping[str, Any]:
        """Plain facts of what really happened, times since `origin` [s]."""
        ...


@dataclass(frozen=True, slots=True)
class DeviceSelection:
    """What the command line says of devices; None where silent.

    `index` counts the runs that the strip on the desk has been through before.
    """

    arm: str | None = None
    camera: str | None = None
    plant: Path | None = None
    seed: int = 0
    index: int = 0
