"""Operators of a calibration: single keys at a terminal, and simulated hands on the twin."""

import os
import select
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from cell.devices.devices import CalibrationAids
from cell.orchestrator.operator import Answer, Ask, Interrupted, Operator, Question

CTRL_D = "\x04"  # Ctrl-D, which a terminal that sends single keys passes on as a character
ENTER = "\n"
KEY_HELP = "Enter go on | s leave out | r the last one again | a go on alone"
POLL_INTERVAL = 0.1  # s between looks at Ctrl-C
ALONE = "a"
ANSWERS = {ENTER: Answer.GO, ALONE: Answer.GO, "s": Answer.SKIP, "r": Answer.AGAIN}
POINTER = frozenset({Ask.POINTER_IN, Ask.POINTER_OUT})


class Keys:
    """Reader of keys from `stream`: single ones within `single_keys`, else whole lines."""

    def __init__(self, stream: TextIO) -> None:
        self._number = _descriptor(stream)
        self._line = b""

    def read(self, seconds: float) -> str | None:
        """Next key in lower case, ENTER, or CTRL_D at the end; None if none comes in `seconds`."""
        number = self._number
        if number is None:
            return CTRL_D
        while select.select([number], [], [], seconds)[0]:
            byte = os.read(number, 1)
            self._line += byte
            if byte in {b"", b"\n"} or _is_single(number):
                typed, self._line = self._line.decode(errors="replace"), b""
                return CTRL_D if typed in {"", CTRL_D} else typed.strip().lower() or ENTER
        return None


@contextmanager
def single_keys(stream: TextIO) -> Iterator[None]:
    """Within the block, let a terminal at `stream` pass on each key as it is typed."""
    number = _descriptor(stream)
    if number is None or not os.isatty(number):
        yield
        return
    before = termios.tcgetattr(number)
    try:
        tty.setcbreak(number, termios.TCSANOW)
        yield
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _descriptor(stream: TextIO) -> int | None:
    """File descriptor of `stream`; None for text in memory."""
    try:
        return stream.fileno()
    except (OSError, ValueError):
        return None


def _is_single(number: int) -> bool:
    """Whether `number` is a terminal that passes on single keys."""
    return os.isatty(number) and not termios.tcgetattr(number)[3] & termios.ICANON


class TwinOperator:
    """Operator of the twin with simulated hands; `person` confirms each step before it is done."""

    def __init__(self, aids: CalibrationAids, person: Operator) -> None:
        self._aids = aids
        self._person = person

    def answer(self, question: Question) -> Answer | None:
        """Ask the person; an answer on the pointer mounts it on the twin, or removes it."""
        answer = self._person.answer(question)
        if answer is not None and question.ask in POINTER:
            self._aids.hold_pointer(question.ask is Ask.POINTER_IN)
        return answer


class Keyboard:
    """Operator at a terminal: Enter continues, s skips, r repeats, a continues without questions.

    Questions on the pointer are asked even then: only a person knows that no hand is in the way.
    On the twin, whose time stands still, it `waits` for a key until `interrupted`; on hardware it
    polls, and the arm stays monitored.
    """

    def __init__(
        self,
        keys: Keys,
        prompt: Callable[[str], None],
        *,
        waits: bool,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        self._keys = keys
        self._prompt = prompt
        self._waits = waits
        self._interrupted = interrupted
        self._asked: Question | None = None
        self._alone = False

    def answer(self, question: Question) -> Answer | None:
        """Answer to `question`; None until a key was typed, or when interrupted.

        Raises Interrupted at the end of the input.
        """
        if self._alone and question.ask not in POINTER:
            return Answer.GO
        if question != self._asked:
            self._asked = question
            self._prompt(f"{question.words}  [{KEY_HELP}]")
        while not self._interrupted():
            key = self._keys.read(POLL_INTERVAL if self._waits else 0.0)
            if key is None and not self._waits:
                return None
            if key == CTRL_D:
                raise Interrupted("the input has ended: nobody answers at the cell")
            if key in ANSWERS:
                self._asked, self._alone = None, self._alone or key == ALONE
                self._prompt("")
                return ANSWERS[key]
            if key is not None:
                self._prompt(f"{question.words}  [{key!r} is no key here; {KEY_HELP}]")
        return None
