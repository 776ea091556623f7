"""One check of the doctor: what was found, why it matters, what to do."""

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
        """The object that `cell doctor --json` prints for it."""
        return {"number": number, **asdict(self)}

    def text(self, number: int) -> str:
        """The check for the operator, the remedy only where there is something to do."""
        head = f"{number:2d}  {self.state:8s}{self.name}: {self.found}"
        return "\n".join([head, *(f"              {each}" for each in self._more())])

    def _more(self) -> list[str]:
        if self.state in (State.PASS, State.SKIPPED):
            return []
        return [f"why: {self.why}", f"do:  {self.remedy}"]
