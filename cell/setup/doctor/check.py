"""Result of one check of `cell doctor`: finding, reason for the check, and remedy."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

DETAIL = " " * 14  # before each line of a check's details


class Grade(StrEnum):
    """Grade of one check by `cell doctor`, where a single FAIL keeps a real robot from
    moving.
    """

    PASS = "pass"  # noqa: S105  no password
    WARN = "warn"
    FAIL = "fail"
    SKIPPED = "skipped"


PASS, WARN, FAIL, SKIPPED = Grade


@dataclass(frozen=True, slots=True)
class Check:
    """Result of one check of the machine or a device: what was `found`, `why` it
    matters, and a `remedy`, which is empty where none is needed.
    """

    name: str
    state: Grade
    found: str
    why: str
    remedy: str = ""

    def line(self, number: int) -> dict[str, Any]:
        """Content of the JSON object on the check, with its `number`, that `cell doctor
        --json` prints.
        """
        return {"number": number, **asdict(self)}

    def text(self, number: int) -> str:
        """Text on the check for the operator, with its `number`, and with a remedy
        unless the check has passed or was skipped.
        """
        head = f"{number:2d}  {self.state:8s}{self.name}: {self.found}"
        if self.state in (PASS, SKIPPED):
            return head
        return f"{head}\n{DETAIL}why: {self.why}\n{DETAIL}do:  {self.remedy}"
