"""Causes of a robot's stop: library errors as one type, classified by class and robot state."""

import json
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Self

from drivers.errors import Fault


class Cause(StrEnum):
    """Causes of arm failures, by their names in the record."""

    REFLEX = "arm_reflex"
    USER_STOP = "arm_user_stop"
    CONTACT = "arm_contact"
    PRESSED = "arm_pressed"
    NETWORK = "arm_network"
    VERSION = "arm_version"
    REALTIME = "arm_realtime"
    REFUSED = "arm_refused"
    COMMAND = "arm_command"
    LIBRARY = "arm_library"
    SILENT = "arm_silent"
    UNHEARD = "arm_cell_silent"
    REACH = "arm_out_of_reach"
    NOT_FINITE = "arm_pose_not_finite"
    LOST = "arm_driver_lost"
    ENDED = "arm_driver_ended"
    PLACE = "arm_out_of_place"
    ASIDE = "arm_pushed_aside"
    WAY = "arm_way_blocked"
    TOOL = "arm_tool_differs"
    MODEL = "arm_limits_differ"


REMEDY = {
    Cause.REFLEX: "look at the robot, then recover with `cell home --recover`",
    Cause.USER_STOP: "release the user stop, then start again",
    Cause.CONTACT: "look what the gripper has met, then start again",
    Cause.PRESSED: "see what touches the arm, and the load in Desk; if it presses on something, "
    "`cell home --recover` retreats 30 mm along the force",
    Cause.NETWORK: "check cable, address and that the robot is on, then start again",
    Cause.VERSION: "install the library that fits the robot, see runbooks/version-mismatch.md",
    Cause.REALTIME: "use a real-time kernel or allow the priority, else set fci.realtime to ignore",
    Cause.REFUSED: "unlock the joints and activate FCI in Desk, then start again",
    Cause.COMMAND: "this is an error of the cell; keep the record",
    Cause.LIBRARY: "keep the record; the library's own words are above",
    Cause.SILENT: "check robot and network, then start again",
    Cause.REACH: "stay nearer to the robot: see `cell fold --dry-run --arm fci`",
    Cause.NOT_FINITE: "keep the record and look for an update of the robot",
    Cause.UNHEARD: "find what held the cell up; the arm braked by itself",
    Cause.ENDED: "the arm braked by itself; start again",
    Cause.LOST: "start again; the motion ended with the process",
    Cause.TOOL: "nothing has moved",
    Cause.MODEL: "nothing has moved; the cell knows the Franka Research 3 alone",
    Cause.WAY: "nothing has moved; guide the arm by hand to where it stands free, then start again",
    Cause.ASIDE: "see what pushed the arm, then `cell home`",
    Cause.PLACE: "bring the arm into the strip's plane with `cell home`",
}


@dataclass(frozen=True, slots=True)
class Failure:
    """Failure of the arm: `cause`, text for the operator, and the robot's `errors` by flag name."""

    cause: Cause
    words: str
    errors: tuple[str, ...] = ()

    def fault(self) -> Fault:
        """Fault that ends the run, with errors and remedy in its text."""
        flags = f" ({', '.join(self.errors)})" if self.errors else ""
        return Fault(self.cause, f"{self.words}{flags}; {REMEDY[self.cause]}")

    def content(self) -> dict[str, Any]:
        """The failure as plain values, for a message between processes."""
        return {"cause": self.cause, "words": self.words, "errors": list(self.errors)}

    @classmethod
    def of(cls, content: dict[str, Any]) -> Self:
        """The failure from plain values, the inverse of `content`."""
        return cls(Cause(content["cause"]), str(content["words"]), tuple(content["errors"]))


class Failed(Exception):
    """Exception that carries a Failure out of the loop."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.words)
        self.failure = failure


def encode(content: dict[str, Any]) -> bytes:
    """Bytes of a message between the cell and the process of the arm, as JSON."""
    return json.dumps(content).encode()


def decode(message: bytes) -> dict[str, Any]:
    """Content of a message that `encode` has turned into bytes."""
    content: dict[str, Any] = json.loads(message)
    return content


def one_line(error: BaseException) -> str:
    """Class and message of `error` in one line for the operator; no decision depends on it."""
    return " ".join(f"{type(error).__name__}: {error}".split())
