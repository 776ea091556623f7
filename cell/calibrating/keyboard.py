"""Operators of a calibration: single keys at a terminal, and simulated hands on the twin."""

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from cell.devices.devices import CalibrationAids, Devices
from cell.orchestrator.operator import Answer, Ask, Operator, Question, Unattended

CTRL_D = "\x04"  # Ctrl-D, which a terminal that sends single keys passes on as a character
ENTER = "\n"
KEY_HELP = "Enter go on | s leave out | r the last one again | a go on alone"
POLL_INTERVAL = 0.1  # s between looks at Ctrl-C
ANSWERS = {ENTER: Answer.GO, "s": Answer.SKIP, "r": Answer.AGAIN}


class Keys:
    """Reader of keys from `stream`: single ones within `single_keys`, else whole lines."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._pending = b""

    def read(self, seconds: float) -> str | None:
        """Next key in lower case, ENTER, or CTRL_D at the end; None if none comes in `seconds`."""
        number = _descriptor(self._stream)
        if number is None:  # text in memory: all of it is there
            return _key(self._stream.readline())
        while not self._is_whole(number):
            if not select.select([number], [], [], seconds)[0]:
                return None
            content = os.read(number, 1024)
            if not content:
                rest, self._pending = self._pending, b""
                return _key(rest.decode(errors="replace"))
            self._pending += content
        size = 1 if _is_single(number) else self._pending.index(b"\n") + 1
        first, self._pending = self._pending[:size], self._pending[size:]
        return _key(first.decode(errors="replace"))

    def _is_whole(self, number: int) -> bool:
        return bool(self._pending) if _is_single(number) else b"\n" in self._pending


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
    try:
        return stream.fileno()
    except (OSError, ValueError):
        return None


def _is_single(number: int) -> bool:
    """Whether `number` is a terminal that passes on single keys."""
    return os.isatty(number) and not termios.tcgetattr(number)[3] & termios.ICANON


def _key(text: str) -> str:
    if text in {"", CTRL_D}:
        return CTRL_D
    return text.strip().lower() or ENTER


class TwinOperator:
    """Operator with simulated hands, who performs on the twin what `person` agrees to."""

    def __init__(self, aids: CalibrationAids, person: Operator) -> None:
        self._aids = aids
        self._person = person

    def answer(self, question: Question) -> Answer | None:
        """Answer of the person, after the pointer was mounted or removed on the twin."""
        answer = self._person.answer(question)
        if answer is not None and question.ask in {Ask.POINTER_IN, Ask.POINTER_OUT}:
            self._aids.hold_pointer(question.ask is Ask.POINTER_IN)
        return answer


class Keyboard:
    """Operator at a terminal: Enter continues, s skips, r repeats, a continues without questions.

    On the twin, whose time stands still, it `waits` for a key until `interrupted`; on hardware it
    polls, and the arm stays monitored. At the end of the input it continues without questions.
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
        """Answer to `question`; None until a key was typed, or when interrupted."""
        if self._alone:
            return Answer.GO
        if question != self._asked:
            self._asked = question
            self._prompt(f"{question.words}  [{KEY_HELP}]")
        while not self._interrupted():
            key = self._keys.read(POLL_INTERVAL if self._waits else 0.0)
            if key is None and not self._waits:
                return None
            if key in {CTRL_D, "a"}:
                self._alone = True
                self._prompt("")
                return Answer.GO
            if key in ANSWERS:
                self._asked = None
                self._prompt("")
                return ANSWERS[key]
            if key is not None:
                self._prompt(f"{question.words}  [{key!r} is no key here; {KEY_HELP}]")
        return None


def operator_of(
    devices: Devices,
    prompt: Callable[[str], None],
    interrupted: Callable[[], bool],
    *,
    interactive: bool,
) -> Operator:
    """Make a run's operator: a person at a real cell, or on the twin on request; else nobody."""
    keys = Keys(sys.stdin)
    if devices.aids is None:
        return Keyboard(keys, prompt, waits=False, interrupted=interrupted)
    if not interactive:
        return TwinOperator(devices.aids, Unattended())
    person = Keyboard(keys, prompt, waits=True, interrupted=interrupted)
    return TwinOperator(devices.aids, person)
