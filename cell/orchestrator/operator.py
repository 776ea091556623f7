"""Protocol of the person at the cell: questions, and answers that may come later."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


class Ask(StrEnum):
    """Kinds of questions."""

    VIEW = "view"
    POINTER_IN = "pointer_in"
    TOUCH = "touch"
    STEPS = "steps"
    POINTER_OUT = "pointer_out"


class Answer(StrEnum):
    """Kinds of answers: continue, skip, repeat the previous one."""

    GO = "go"
    SKIP = "skip"
    AGAIN = "again"


@dataclass(frozen=True, slots=True)
class Question:
    """A kind of question with its text."""

    ask: Ask
    words: str


class Operator(Protocol):
    """Answers questions. A run polls on each tick while its monitors stay active."""

    def answer(self, question: Question) -> Answer | None:
        """The answer, or None until there is one."""


class Unattended:
    """An operator that always continues."""

    def answer(self, _: Question) -> Answer | None:
        """Continue at once."""
        return Answer.GO
