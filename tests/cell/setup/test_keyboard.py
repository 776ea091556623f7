"""The operator's keys, at the twin and at a cell whose arm goes on being watched."""

import os
import pty
import select
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from cell.orchestrator.operator import Answer, Interrupted, Question
from cell.setup.wizard_panel import Keyboard, Keys

TOUCH = Question("point 4: 3 of 24 points are touched")


@contextmanager
def typing(
    content: str, prompt: Callable[[str], None] = lambda _: None, *, waits: bool = True
) -> Iterator[Keyboard]:
    """A keyboard at a pipe through which `content` comes."""
    reader, writer = os.pipe()
    os.write(writer, content.encode())
    os.close(writer)
    with os.fdopen(reader) as stream:
        yield Keyboard(Keys(stream), prompt, waits=waits)


def test_keys_mean_go_leave_out_and_again() -> None:
    said: list[str] = []
    with typing("\ns\nR\n", said.append) as keyboard:
        answers = [keyboard.answer(TOUCH) for _ in range(3)]
    assert answers == [Answer.GO, Answer.SKIP, Answer.AGAIN]
    assert said[0].startswith("point 4: 3 of 24 points are touched  [Enter go on")


def test_from_a_on_it_goes_on_alone_but_for_the_pointer() -> None:
    with typing("a\ns\n") as keyboard:
        assert [keyboard.answer(TOUCH) for _ in range(3)] == 3 * [Answer.GO]
        assert keyboard.answer(Question("take it out", reaches=True)) is Answer.SKIP


@pytest.mark.parametrize("waits", [True, False])
def test_the_end_of_input_confirms_nothing(waits: bool) -> None:
    with (
        typing("", waits=waits) as keyboard,
        pytest.raises(Interrupted, match="input has ended"),
    ):
        keyboard.answer(TOUCH)


def test_on_hardware_no_key_is_no_answer_and_nothing_waits() -> None:
    reader, writer = os.pipe()
    said: list[str] = []
    with os.fdopen(reader) as lines, os.fdopen(writer, "w") as typed:
        keyboard = Keyboard(Keys(lines), said.append, waits=False)
        assert keyboard.answer(TOUCH) is None
        assert keyboard.answer(TOUCH) is None
        assert len(said) == 1
        typed.write("s\n")
        typed.flush()
        assert keyboard.answer(TOUCH) is Answer.SKIP


SITTING = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from cell.setup.wizard_panel import Keyboard, Keys, single_keys
from cell.orchestrator.operator import Interrupt
from cell.orchestrator.operator import Question

with Interrupt() as interrupted, single_keys(sys.stdin):
    keyboard = Keyboard(Keys(sys.stdin), print, waits=True, interrupted=interrupted)
    for number in range(2):
        print("answer", keyboard.answer(Question(f"point {number}")), flush=True)
"""


class Typist:
    """A process at a terminal of its own, and what stands on its screen."""

    def __init__(self) -> None:
        self.terminal, theirs = pty.openpty()
        self.modes = termios.tcgetattr(theirs)[3]
        self.process = subprocess.Popen(
            [sys.executable, "-c", SITTING],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
        )
        self._theirs, self.screen = theirs, ""

    def type(self, keys: str) -> None:
        os.write(self.terminal, keys.encode())

    def wait_for(self, words: str) -> None:
        until = time.monotonic() + 20.0
        while words not in self.screen:
            ready = select.select(
                [self.terminal], [], [], max(until - time.monotonic(), 0.0)
            )[0]
            assert ready, self.screen
            self.screen += os.read(self.terminal, 4096).decode()

    def end(self) -> int:
        assert self.process.wait(20.0) == 0, self.screen
        modes = termios.tcgetattr(self._theirs)[3]
        os.close(self._theirs)
        os.close(self.terminal)
        return modes


def test_terminal_answers_by_single_keys_and_is_as_before_afterwards() -> None:
    typist = Typist()
    typist.wait_for("point 0")
    typist.type("s")
    typist.wait_for("answer skip")
    typist.type("\n")
    typist.wait_for("answer go")
    assert typist.end() == typist.modes
