"""The operator's keys, at the twin and at a cell whose arm goes on being watched."""

import io
import os
from types import SimpleNamespace

import pytest

from cell.operations.keyboard import Keyboard, TwinOperator
from cell.orchestrator.operator import Answer, Ask, Question, Unattended

TOUCH = Question(Ask.TOUCH, "point 4: 3 of 24 points are touched")


def test_keys_mean_go_leave_out_and_again() -> None:
    said: list[str] = []
    keyboard = Keyboard(io.StringIO("\ns\nR\n"), said.append, waits=True)
    answers = [keyboard.answer(TOUCH) for _ in range(3)]
    assert answers == [Answer.GO, Answer.SKIP, Answer.AGAIN]
    assert said[0].startswith("point 4: 3 of 24 points are touched  [Enter go on")


def test_unknown_key_is_asked_for_again() -> None:
    said: list[str] = []
    keyboard = Keyboard(io.StringIO("w\n\n"), said.append, waits=True)
    assert keyboard.answer(TOUCH) is Answer.GO
    assert said[-1].startswith("'w' is no key here")


def test_from_a_on_and_at_the_end_of_input_it_goes_on_alone() -> None:
    for content in ("a\ns\n", ""):
        keyboard = Keyboard(io.StringIO(content), lambda _: None, waits=True)
        assert [keyboard.answer(TOUCH) for _ in range(3)] == 3 * [Answer.GO]


def test_on_hardware_no_key_is_no_answer_and_nothing_waits() -> None:
    reader, writer = os.pipe()
    said: list[str] = []
    with os.fdopen(reader) as lines, os.fdopen(writer, "w") as typed:
        keyboard = Keyboard(lines, said.append, waits=False)
        assert keyboard.answer(TOUCH) is None
        assert keyboard.answer(TOUCH) is None
        assert len(said) == 1
        typed.write("s\n")
        typed.flush()
        assert keyboard.answer(TOUCH) is Answer.SKIP


@pytest.mark.parametrize(("ask", "held"), [(Ask.POINTER_IN, True), (Ask.POINTER_OUT, False)])
def test_twin_has_hands_for_the_pointer(ask: Ask, held: bool) -> None:
    done: list[bool] = []
    operator = TwinOperator(SimpleNamespace(hold_pointer=done.append), Unattended())
    assert operator.answer(TOUCH) is Answer.GO
    assert done == []
    operator.answer(Question(ask, "the pointer"))
    assert done == [held]
