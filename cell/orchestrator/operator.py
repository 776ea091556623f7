"""The operator at the cell: questions with answers that may come later, and Ctrl-C."""

import signal
from dataclasses import dataclass
from enum import StrEnum
from types import FrameType
from typing import Any, Protocol, Self

from drivers.errors import CellError


class Ask(StrEnum):
    """Kinds of questions to the operator."""

    VIEW = "view"
    POINTER_IN = "pointer_in"
    TOUCH = "touch"
    STEPS = "steps"
    POINTER_OUT = "pointer_out"


class Answer(StrEnum):
    """Kinds of answers by the operator: continue, skip, repeat the previous one."""

    GO = "go"
    SKIP = "skip"
    AGAIN = "again"


@dataclass(frozen=True, slots=True)
class Question:
    """Question to the operator: its kind and its text."""

    ask: Ask
    words: str


class Operator(Protocol):
    """Protocol of an operator, polled by a run on each tick while its monitors stay active."""

    def answer(self, question: Question) -> Answer | None:
        """Answer to `question`, or None until there is one."""


class Unattended:
    """An operator that always continues."""

    def answer(self, _: Question) -> Answer | None:
        """Continue at once."""
        return Answer.GO


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(CellError):
    """Error of an operation, other than a fold, that was interrupted from the keyboard."""

    exit_code = 130


class Interrupt:
    """Context manager that counts SIGNALS; the first is only remembered, later ones raise."""

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Whether a controlled stop was requested."""
        return self._asked

    def __enter__(self) -> Self:
        """Install the signal handlers."""
        self._before = {number: signal.signal(number, self._count_signal) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the previous signal handlers."""
        for number, before in self._before.items():
            signal.signal(number, before)

    def _count_signal(self, _number: int, _frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
