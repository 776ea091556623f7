"""Operator at the cell: questions that a run asks, their answers, interruption by
Ctrl-C.
"""

import signal
from dataclasses import dataclass
from enum import StrEnum
from types import FrameType
from typing import Any, Protocol, Self

from drivers.base.errors import CellError

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Answer(StrEnum):
    """Answers of the operator to a question: continue, skip, repeat the previous
    step.
    """

    GO = "go"
    SKIP = "skip"
    AGAIN = "again"


@dataclass(frozen=True, slots=True)
class Question:
    """Question to the operator: its text, and whether a person `reaches` into the
    gripper.
    """

    words: str
    reaches: bool = False


class Operator(Protocol):
    """Protocol of an operator, who is asked on each tick of a run while its monitors
    stay active.
    """

    def answer(self, question: Question) -> Answer | None:
        """Answer to `question`; None as long as the operator has not answered."""


class Unattended:
    """Operator that answers every question with "continue"."""

    def answer(self, _: Question) -> Answer | None:
        """Answer "continue" at once, whatever the question."""
        return Answer.GO


class Interrupted(CellError):
    """Error of an operation, other than a fold, interrupted by Ctrl-C or a signal."""

    exit_code = 130


class Interrupt:
    """Context manager that lets the first signal of SIGNALS request a stop and any
    later one raise KeyboardInterrupt.
    """

    def __init__(self) -> None:
        self._requested = False
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Whether the operator or a signal requested a controlled stop."""
        return self._requested

    def __enter__(self) -> Self:
        """Install the handlers of the stop signals."""
        self._before = {
            number: signal.signal(number, self._count_signal) for number in SIGNALS
        }
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the signal handlers that were installed before the block."""
        for number, before in self._before.items():
            signal.signal(number, before)

    def _count_signal(self, _number: int, _frame: FrameType | None) -> None:
        """Request a stop at the first signal; raise KeyboardInterrupt at a later
        one.
        """
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True
