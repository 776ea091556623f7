"""Common parts of the calibration verdicts: reasons for refusal, and graded lines to
print.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar


class Level(StrEnum):
    """Grade of a line of text that is printed for the operator: good, fair, bad, or
    plain, which is no grade.
    """

    GOOD = "good"
    FAIR = "fair"
    BAD = "bad"
    PLAIN = "plain"


@dataclass(frozen=True, slots=True)
class Line:
    """Line of text for the operator on a calibration, with its grade."""

    level: Level
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationVerdict:
    """Result of a calibration: lines on what was `found`, and the `reasons` to refuse
    it, which are empty where it may be used.

    It is `clean` where there is nothing to improve. `good` and `refused` say what to do
    next.
    """

    found: tuple[Line, ...] = ()
    reasons: tuple[str, ...] = ()
    clean: bool = True
    good: ClassVar[str] = ""
    refused: ClassVar[str] = ""

    @property
    def passed(self) -> bool:
        """Whether the result of the calibration may be used."""
        return not self.reasons

    def lines(self) -> tuple[Line, ...]:
        """Lines of text for the operator: what was found, the reasons to refuse it, and
        what to do next.
        """
        end = Line(Level.FAIR, f"usable: {self.good}")
        if self.reasons:
            end = Line(Level.BAD, f"refused: {self.refused}")
        elif self.clean:
            end = Line(Level.GOOD, f"good: {self.good}")
        return (*self.found, *(Line(Level.BAD, reason) for reason in self.reasons), end)

    def facts(self) -> dict[str, Any]:
        """Plain values of the result, as the option `--json` prints and the session's
        verdict file keeps them.
        """
        return {
            "lines": [line.text for line in self.lines()],
            "reasons": list(self.reasons),
        }


def reasons(*facts: tuple[bool, str]) -> tuple[str, ...]:
    """Texts of those of the given pairs of a condition and a text whose condition is
    true.
    """
    return tuple(text for holds, text in facts if holds)


def grade_line(value: float, good: float, fair: float, text: str) -> Line:
    """Line with `text` whose grade depends on `value`: good up to the value `good`,
    fair up to `fair`, else bad.
    """
    if value <= good:
        return Line(Level.GOOD, text)
    return Line(Level.FAIR if value <= fair else Level.BAD, text)
