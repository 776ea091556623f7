"""Lock-free publication of the latest value from one process to another, without torn reads."""

import ctypes
import struct
from multiprocessing.context import BaseContext
from typing import Any, Generic, NamedTuple, TypeVar

from drivers.errors import Fault

WORD = 8  # bytes
TRIES = 1000

V = TypeVar("V", bound=NamedTuple)


def allocate(layout: str, context: BaseContext) -> Any:
    """Shared memory for a `Latest` of `layout`, passed to a process that `context` starts."""
    return context.RawArray(ctypes.c_uint64, 1 + 2 * _words(layout))


class Latest(Generic[V]):
    """Value in shared memory with one writer and any readers, none of which blocks another.

    The writer fills the hidden one of two slots, then publishes it. A reader retries only when the
    writer has reused its slot meanwhile, so that a writer that dies in mid write blocks nobody.
    Relies on stores that become visible in order, as on x86-64, the only machine that the robot's
    library is built for.
    """

    def __init__(self, memory: Any, kind: type[V], layout: str) -> None:
        """Map `memory` from `allocate`; fields of `kind` have the order of the struct `layout`."""
        self._struct = struct.Struct(layout)
        self._kind = kind
        view = memoryview(memory).cast("B")
        self._count = view[:WORD].cast("Q")
        size = WORD * _words(layout)
        self._slots = (view[WORD : WORD + size], view[WORD + size : WORD + 2 * size])

    @property
    def count(self) -> int:
        """Number of values written so far."""
        return self._count[0]

    def write(self, value: V) -> None:
        """Publish `value` as the newest one."""
        after = self._count[0] + 1
        self._struct.pack_into(self._slots[after & 1], 0, *value)
        self._count[0] = after

    def read(self) -> V:
        """The newest value, zeros before the first write; Fault `arm_memory` after many tries."""
        for _ in range(TRIES):
            before = self._count[0]
            content = bytes(self._slots[before & 1])
            if self._count[0] == before:
                return self._kind._make(self._struct.unpack_from(content))
        raise Fault("arm_memory", "the arm's process writes faster than it can be read")


def _words(layout: str) -> int:
    return -(-struct.calcsize(layout) // WORD)
