"""The person at the cell, as a run asks him: questions, and answers that may take their time."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


class Ask(StrEnum):
    """What the person is asked for."""

    VIEW = "view"
    POINTER_IN = "pointer_in"
    TOUCH = "touch"
    STEPS = "steps"
    POINTER_OUT = "pointer_out"


class Answer(StrEnum):
    """What he says: go on, leave this out, do the one before again."""

    GO = "go"
    SKIP = "skip"
    AGAIN = "again"


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked, in words."""

    ask: Ask
    words: str


class Operator(Protocol):
    """Answers questions. A run polls on each tick and goes on watching its monitors."""

    def answer(self, question: Question) -> Answer | None:
        """The answer, or None as long as there is none."""
        ...


class Unattended:
    """Nobody is there: always go on."""

    def answer(self, _: Question) -> Answer | None:
        """Go."""
        return Answer.GO
