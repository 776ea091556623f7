"""Values that pass from process to process through shared memory."""

from multiprocessing import get_context
from typing import NamedTuple

import pytest

from drivers.arm.latest import Latest, allocate
from drivers.errors import Fault

LAYOUT = "=8q"
CONTEXT = get_context("spawn")


class Eight(NamedTuple):
    a: int
    b: int
    c: int
    d: int
    e: int
    f: int
    g: int
    h: int


def write_for_ever(memory, start) -> None:
    values = Latest(memory, Eight, LAYOUT)
    start.set()
    number = 0
    while True:
        number += 1
        values.write(Eight(*[number] * 8))


def test_no_value_is_ever_torn() -> None:
    memory, start = allocate(LAYOUT, CONTEXT), CONTEXT.Event()
    process = CONTEXT.Process(target=write_for_ever, args=(memory, start), daemon=True)
    process.start()
    values, last = Latest(memory, Eight, LAYOUT), 0
    assert start.wait(20)
    try:
        for _ in range(20_000):
            seen = values.read()
            assert len(set(seen)) == 1
            assert seen.a >= last
            last = seen.a
    finally:
        process.kill()
        process.join()
    assert values.read().a >= last  # a writer that was killed holds nobody up


def test_newest_value_is_read() -> None:
    values = Latest(allocate(LAYOUT, CONTEXT), Eight, LAYOUT)
    assert values.read() == Eight(*[0] * 8)
    for number in (1, 2, 3):
        values.write(Eight(*[number] * 8))
    assert values.read().h == 3
    assert values.count == 3


def test_reader_gives_up_on_a_writer_that_is_always_faster() -> None:

    values = Latest(allocate(LAYOUT, CONTEXT), Eight, LAYOUT)

    class Rising:
        def __init__(self) -> None:
            self.value = 0

        def __getitem__(self, _: int) -> int:
            self.value += 1
            return self.value

    values._count = Rising()
    with pytest.raises(Fault, match="faster"):
        values.read()
