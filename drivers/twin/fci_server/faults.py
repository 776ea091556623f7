"""Faults of the emulated robot and its connection: as a script states them, and their
execution.
"""

from collections.abc import Callable, Iterable, Iterator
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, NonNegativeInt

from drivers.base.settings import Settings, VersionedFile, load
from drivers.twin.fci_server.arm_and_hand_ports import ArmPort
from drivers.twin.fci_server.dynamics import RateReport
from drivers.twin.fci_server.robot import EmulatedRobot
from drivers.twin.fci_server.wire import Reflex

REFLEX_NAMES = tuple(reflex.name.lower() for reflex in Reflex)


def _check_name(name: str) -> str:
    if name not in REFLEX_NAMES:
        raise ValueError(
            f"is no error of the robot; allowed: {', '.join(REFLEX_NAMES)}"
        )
    return name


def _check_force(force: tuple[float, float, float]) -> tuple[float, float, float]:
    if not all(isfinite(part) for part in force) or not any(force):
        raise ValueError("needs three finite numbers [N], one of them not zero")
    return force


class ScriptedFault(Settings):
    """Fault of the emulated robot, due once it has executed `at` commands since its
    start.
    """

    at: NonNegativeInt


class ReflexFault(ScriptedFault):
    """Fault: the robot stops by a reflex and reports `error`."""

    kind: Literal["reflex"]
    error: Annotated[str, AfterValidator(_check_name)] = "cartesian_reflex"


class UserStopFault(ScriptedFault):
    """Fault: the user stop is pressed, and released after `duration` [s] if that is
    finite.
    """

    kind: Literal["user_stop"]
    duration: float = Field(default=inf, gt=0, allow_inf_nan=True)


class DropFault(ScriptedFault):
    """Fault: the robot closes the TCP connection of the arm's client."""

    kind: Literal["tcp_drop"]


class FreezeFault(ScriptedFault):
    """Fault: the robot neither sends nor answers for `duration` [s] of the wall
    clock.
    """

    kind: Literal["freeze"]
    duration: float = Field(gt=0, le=60)


class NanFault(ScriptedFault):
    """Fault: for `ticks` ticks the measured joints, pose and force in the robot's state
    are NaN.
    """

    kind: Literal["nan"]
    ticks: int = Field(default=1, gt=0)


class ContactFault(ScriptedFault):
    """Fault: a `force` (3,) [N] in the base acts on the tool for `duration` [s] of
    robot time.
    """

    kind: Literal["contact"]
    force: Annotated[tuple[float, float, float], AfterValidator(_check_force)]
    duration: float = Field(default=inf, gt=0, allow_inf_nan=True)


class VersionFault(ScriptedFault):
    """Fault: from then on the robot speaks protocol `version` and refuses new
    connections.
    """

    kind: Literal["wrong_version"]
    version: int = Field(default=9, ge=0, le=65535)


class RatesFault(ScriptedFault):
    """Fault: the rates of the commanded joints are `reported` filtered, late, zero, or
    as measured.
    """

    kind: Literal["rates"]
    reported: RateReport


class ModelFault(ScriptedFault):
    """Fault: the robot takes a `share` of what moves and holds itself for external
    torques.
    """

    kind: Literal["wrong_model"]
    share: float = Field(ge=-1, le=1)


class LossFault(ScriptedFault):
    """Fault: the network loses a `share` of the commands; the robot extrapolates, or
    holds its joints.

    Which ones is drawn from `seed`.
    """

    kind: Literal["lost_commands"]
    share: float = Field(ge=0, le=0.5)
    holds: bool = False
    seed: int = Field(default=0, ge=0)


Fault = (
    ReflexFault
    | UserStopFault
    | DropFault
    | FreezeFault
    | NanFault
    | ContactFault
    | VersionFault
    | RatesFault
    | ModelFault
    | LossFault
)


class FaultScript(VersionedFile):
    """Content of a fault script: version `schema` of the format, and the scheduled
    faults.
    """

    faults: tuple[Annotated[Fault, Field(discriminator="kind")], ...]


def load_faults(path: Path) -> tuple[Fault, ...]:
    """Read the faults in the script at `path`, earliest first; raises
    ConfigurationError where the script is invalid.
    """
    return tuple(sorted(load(path, FaultScript).faults, key=lambda fault: fault.at))


def lost_commands(share: float, seed: int) -> Iterator[bool]:
    """Yield endlessly for one command after the other whether it is lost, as a random
    fraction `share` of them is.
    """
    rng = np.random.default_rng(seed)
    while True:
        yield bool(rng.random() < share)


Pause = Callable[[float], None]  # returns after a time [s]


class Disturbance:
    """Faults of a script that are still to strike the emulated robot, and the end times
    of those in effect.

    They strike `robot`, or the connection to its client at `port`; `freeze` pauses both
    for some time [s].
    """

    def __init__(
        self,
        script: Iterable[Fault],
        robot: EmulatedRobot,
        port: ArmPort,
        freeze: Pause,
    ) -> None:
        self._waiting = sorted(script, key=lambda fault: fault.at)
        self._robot = robot
        self._port = port
        self._freeze = freeze
        self._push_ends = inf
        self._release = inf

    def add(self, fault: Fault) -> None:
        """Schedule another `fault`, which strikes at once if the robot has already
        executed the number of commands it waits for.
        """
        self._waiting = sorted([*self._waiting, fault], key=lambda waiting: waiting.at)

    def strike(self) -> None:
        """Apply the faults that are due by now, and end those whose time is over."""
        robot = self._robot
        if robot.time >= self._release:
            robot.release_user_stop()
            self._release = inf
        if robot.time >= self._push_ends:
            robot.pushed = np.zeros(3)
            self._push_ends = inf
        while self._waiting and self._waiting[0].at <= robot.ticks:
            self._apply(self._waiting.pop(0))

    def _apply(self, fault: Fault) -> None:
        """Let the scripted `fault` begin."""
        robot = self._robot
        match fault:
            case ReflexFault():
                robot.reflex(Reflex[fault.error.upper()])
            case UserStopFault():
                robot.press_user_stop()
                self._release = robot.time + 1000 * fault.duration
            case NanFault():
                robot.sensors_fail_until = robot.time + 1 + fault.ticks
            case ContactFault():
                robot.pushed = np.array(fault.force)
                self._push_ends = robot.time + 1000 * fault.duration
            case DropFault():
                self._port.drop()
            case RatesFault():
                robot.reported.kind = fault.reported
            case ModelFault():
                robot.mistaken = fault.share
            case LossFault():
                robot.holds = fault.holds
                robot.losses = lost_commands(fault.share, fault.seed)
            case VersionFault():
                self._port.version = fault.version
            case FreezeFault():
                self._freeze(fault.duration)
