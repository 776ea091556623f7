"""Common parts of the calibration verdicts: reasons for refusal, and graded lines to print."""

from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """Grade of a line printed for the operator: good, fair, bad, or plain without a grade."""

    GOOD = "good"
    FAIR = "fair"
    BAD = "bad"
    PLAIN = "plain"


@dataclass(frozen=True, slots=True)
class Line:
    """Line of a verdict for the operator, with its grade."""

    level: Level
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Base of a calibration's result, with the `reasons` for which it is refused, if any."""

    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the result of the calibration may be used."""
        return not self.reasons

    def bad_lines(self) -> list[Line]:
        """Lines for the operator, one for each reason for refusal."""
        return [Line(Level.BAD, reason) for reason in self.reasons]

    def last_line(self, good: str, refused: str) -> Line:
        """Line on the operator's next step: `good` if the result passed, else `refused`."""
        if self.passed:
            return Line(Level.GOOD, f"good: {good}")
        return Line(Level.BAD, f"refused: {refused}")


def reasons(*facts: tuple[bool, str]) -> tuple[str, ...]:
    """Texts of the given (condition, text) pairs whose condition is true."""
    return tuple(text for holds, text in facts if holds)


def grade_line(value: float, good: float, fair: float, text: str) -> Line:
    """Line with `text`, graded by `value`: good up to `good`, fair up to `fair`, else bad."""
    if value <= good:
        return Line(Level.GOOD, text)
    return Line(Level.FAIR if value <= fair else Level.BAD, text)
