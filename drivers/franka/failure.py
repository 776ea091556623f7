"""Causes for which an arm stops or does not start, and the fault that states one."""

from enum import StrEnum
from typing import Self

from drivers.base.errors import Fault


class Cause(StrEnum):
    """Causes of arm faults, named as in a run's record, each with a `remedy` for the
    operator.
    """

    remedy: str

    REFLEX = "arm_reflex", "look at the robot, then recover with `cell home --recover`"
    USER_STOP = "arm_user_stop", "release the user stop, then start again"
    CONTACT = "arm_contact", "look what the gripper has met, then start again"
    PRESSED = (
        "arm_pressed",
        (
            "see what touches the arm, and the load in Desk; if it presses on"
            " something, `cell home --recover` retreats 30 mm along the force"
        ),
    )
    NETWORK = (
        "arm_network",
        "check cable, address and that the robot is on, then start again",
    )
    VERSION = (
        "arm_version",
        "install the library that fits the robot, see runbooks/version-mismatch.md",
    )
    REALTIME = (
        "arm_realtime",
        "use a real-time kernel or allow the priority, else set fci.realtime to ignore",
    )
    REFUSED = (
        "arm_refused",
        "unlock the joints and activate FCI in Desk, then start again",
    )
    COMMAND = "arm_command", "this is an error of the cell; keep the record"
    LIBRARY = "arm_library", "keep the record; the library's own words are above"
    SILENT = "arm_silent", "check robot and network, then start again"
    CELL_SILENT = (
        "arm_cell_silent",
        "find what held the cell up; the arm braked by itself",
    )
    REACH = (
        "arm_out_of_reach",
        "stay nearer to the robot: see `cell fold --dry-run --arm fci`",
    )
    NOT_FINITE = (
        "arm_pose_not_finite",
        "keep the record and look for an update of the robot",
    )
    LOST = "arm_driver_lost", "start again; the motion ended with the process"
    ENDED = "arm_driver_ended", "the arm braked by itself; start again"
    PLACE = "arm_out_of_place", "bring the arm into the strip's plane with `cell home`"
    ASIDE = "arm_pushed_aside", "see what pushed the arm, then `cell home`"
    BLOCKED = (
        "arm_way_blocked",
        (
            "nothing has moved; guide the arm by hand to where it stands free, then"
            " start again"
        ),
    )
    TOOL = "arm_tool_differs", "nothing has moved"
    MODEL = (
        "arm_limits_differ",
        "nothing has moved; the cell knows the Franka Research 3 alone",
    )

    def __new__(cls, name: str, remedy: str) -> Self:
        """Cause of an arm fault that equals the text `name`."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.remedy = remedy
        return member


class ArmFault(Fault):
    """Fault of the arm: `cause`, what happened in `words`, names of the robot's error
    flags.
    """

    def __init__(self, cause: Cause, words: str, errors: tuple[str, ...] = ()) -> None:
        flags = f" ({', '.join(errors)})" if errors else ""
        super().__init__(cause, f"{words}{flags}; {cause.remedy}")
        self.cause = cause
        self.words = words
        self.errors = errors


def one_line(error: BaseException) -> str:
    """Class and message of `error` in one line of text, for people to read."""
    return " ".join(f"{type(error).__name__}: {error}".split())
