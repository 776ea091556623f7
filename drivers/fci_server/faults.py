"""The fault script: scheduled faults of the emulated robot."""

from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from drivers.fci_server.reflex import Reflex
from drivers.settings import Settings, load

REFLEX_NAMES = tuple(reflex.name.lower() for reflex in Reflex)


def _check_name(name: str) -> str:
    if name not in REFLEX_NAMES:
        raise ValueError(f"is no error of the robot; allowed: {', '.join(REFLEX_NAMES)}")
    return name


def _check_force(force: tuple[float, float, float]) -> tuple[float, float, float]:
    if not all(isfinite(part) for part in force) or not any(force):
        raise ValueError("needs three finite numbers [N], one of them not zero")
    return force


class Scripted(Settings):
    """A fault at control tick `at`: the count of commands followed since the server began."""

    at: int = Field(ge=0)


class ReflexFault(Scripted):
    """The robot stops by a reflex and names `error`."""

    kind: Literal["reflex"]
    error: Annotated[str, AfterValidator(_check_name)] = "cartesian_reflex"


class UserStopFault(Scripted):
    """The user stop is pressed, and released after `duration` [s] or never."""

    kind: Literal["user_stop"]
    duration: float = Field(default=inf, gt=0, allow_inf_nan=True)


class DropFault(Scripted):
    """The TCP connection of the arm's client is closed."""

    kind: Literal["tcp_drop"]


class FreezeFault(Scripted):
    """The server neither sends nor answers for `duration` [s] of the wall clock."""

    kind: Literal["freeze"]
    duration: float = Field(gt=0, le=60)


class NanFault(Scripted):
    """For `ticks` ticks the joints, pose and force of the state are NaN."""

    kind: Literal["nan"]
    ticks: int = Field(default=1, gt=0)


class ContactFault(Scripted):
    """A force [N] in the base pushes the tool for `duration` [s] of robot time, or from then on."""

    kind: Literal["contact"]
    force: Annotated[tuple[float, float, float], AfterValidator(_check_force)]
    duration: float = Field(default=inf, gt=0, allow_inf_nan=True)


class VersionFault(Scripted):
    """The robot speaks another protocol `version`: new connections are refused from then on."""

    kind: Literal["wrong_version"]
    version: int = Field(default=9, ge=0, le=65535)


Fault = (
    ReflexFault | UserStopFault | DropFault | FreezeFault | NanFault | ContactFault | VersionFault
)


class FaultScript(Settings):
    """Content of a fault script's file: its schema and the scheduled faults."""

    schema_: Literal[1] = Field(default=1, alias="schema")
    faults: tuple[Annotated[Fault, Field(discriminator="kind")], ...]


def load_faults(path: Path) -> tuple[Fault, ...]:
    """The faults in a file, earliest first; ConfigurationError for anything unreadable."""
    return tuple(sorted(load(path, FaultScript).faults, key=lambda fault: fault.at))
