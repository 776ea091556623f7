"""One check of the doctor: its finding, why it matters, and its remedy."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class State(StrEnum):
    """Results of a check; a cell of which one is red moves no robot."""

    PASS = "pass"  # noqa: S105  no password
    WARN = "warn"
    FAIL = "fail"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Check:
    """Result of the check `name`; `remedy` is empty where nothing is to do."""

    name: str
    state: State
    found: str
    why: str
    remedy: str = ""

    def line(self, number: int) -> dict[str, Any]:
        """The check as an object of `cell doctor --json`."""
        return {"number": number, **asdict(self)}

    def text(self, number: int) -> str:
        """The check as text for the operator, with a remedy only where there is one."""
        head = f"{number:2d}  {self.state:8s}{self.name}: {self.found}"
        return "\n".join([head, *(f"              {each}" for each in self._details())])

    def _details(self) -> list[str]:
        if self.state in (State.PASS, State.SKIPPED):
            return []
        return [f"why: {self.why}", f"do:  {self.remedy}"]
