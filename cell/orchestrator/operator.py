"""Protocol of the operator at the cell: questions, and answers that may come later."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


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
