"""The operator's answers: keys at a terminal, and simulated hands on the twin."""

import select
import sys
from collections.abc import Callable
from typing import TextIO

from cell.devices.devices import CalibrationAids, Devices
from cell.orchestrator.operator import Answer, Ask, Operator, Question, Unattended

KEYS = "Enter go on | s leave out | r the last one again | a go on alone"
ANSWERS = {"": Answer.GO, "s": Answer.SKIP, "r": Answer.AGAIN}


class TwinOperator:
    """Performs on the twin what `person` agrees to."""

    def __init__(self, aids: CalibrationAids, person: Operator) -> None:
        self._aids = aids
        self._person = person

    def answer(self, question: Question) -> Answer | None:
        """The person's answer, after the pointer was put in or removed."""
        answer = self._person.answer(question)
        if answer is not None and question.ask in {Ask.POINTER_IN, Ask.POINTER_OUT}:
            self._aids.hold_pointer(question.ask is Ask.POINTER_IN)
        return answer


class Keyboard:
    """Lines of a terminal: Enter continues, s skips, r repeats, a continues without further
    questions.

    On the twin, whose time stands still, it waits for the line; on hardware it polls, and the arm
    stays monitored. At the end of the input it continues without questions.
    """

    def __init__(self, lines: TextIO, prompt: Callable[[str], None], *, waits: bool) -> None:
        self._lines = lines
        self._prompt = prompt
        self._waits = waits
        self._asked: Question | None = None
        self._alone = False

    def answer(self, question: Question) -> Answer | None:
        """The answer to `question`; None until something was typed."""
        if self._alone:
            return Answer.GO
        if question != self._asked:
            self._asked = question
            self._prompt(f"{question.words}  [{KEYS}]")
        while self._waits or select.select([self._lines], [], [], 0.0)[0]:
            line = self._lines.readline()
            key = line.strip().lower()
            if not line or key == "a":
                self._alone = True
                return Answer.GO
            if key in ANSWERS:
                self._asked = None
                return ANSWERS[key]
            self._prompt(f"{key!r} is no key here; {KEYS}")
        return None


def operator_of(devices: Devices, prompt: Callable[[str], None], *, interactive: bool) -> Operator:
    """The operator of a run: a person at a real cell, and on the twin on request; else nobody."""
    if devices.aids is None:
        return Keyboard(sys.stdin, prompt, waits=False)
    person = Keyboard(sys.stdin, prompt, waits=True) if interactive else Unattended()
    return TwinOperator(devices.aids, person)
