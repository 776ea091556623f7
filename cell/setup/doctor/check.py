"""Result of one check of `cell doctor`: finding, reason for the check, and remedy."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

DETAIL = " " * 14  # before each line of a check's details


class Grade(StrEnum):
    """Grade of a check of `cell doctor`; a single FAIL keeps a real robot from
    moving.
    """

    PASS = "pass"  # noqa: S105  no password
    WARN = "warn"
    FAIL = "fail"
    SKIPPED = "skipped"


PASS, WARN, FAIL, SKIPPED = Grade


@dataclass(frozen=True, slots=True)
class Check:
    """Result of a check: what was `found`, `why` it matters, and a `remedy`, empty
    where none.
    """

    name: str
    state: Grade
    found: str
    why: str
    remedy: str = ""

    def line(self, number: int) -> dict[str, Any]:
        """JSON object of the check, numbered, as `cell doctor --json` prints it."""
        return {"number": number, **asdict(self)}

    def text(self, number: int) -> str:
        """Text of the check for the operator, with a remedy where there is one."""
        head = f"{number:2d}  {self.state:8s}{self.name}: {self.found}"
        if self.state in (PASS, SKIPPED):
            return head
        return f"{head}\n{DETAIL}why: {self.why}\n{DETAIL}do:  {self.remedy}"
