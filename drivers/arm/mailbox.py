"""Commands to the robot's 1 kHz loop and its reports: the newest of each, in shared memory."""

import os
import struct
from enum import IntEnum
from mmap import mmap
from typing import Any, Generic, NamedTuple, TypeVar

from drivers.child import SharedMemory
from drivers.errors import Fault

WORD = 8  # bytes
TRIES = 1000

V = TypeVar("V", bound=NamedTuple)


class CommandKind(IntEnum):
    """Kinds of commands to the process that owns the robot."""

    HOLD = 0
    FOLLOW = 1
    MOVE = 2


class LoopCommand(NamedTuple):
    """The newest command to the loop: its `kind`, with a pose or a velocity in `x`, `z`, `pitch`.

    `number` rises with each command, which the loop executes once; `beat` counts heartbeats.
    """

    number: int
    kind: int
    beat: int
    x: float
    z: float
    pitch: float


class Report(NamedTuple):
    """The newest state of the arm, after `ticks` of its motion, at `arrival` [s] of the clock.

    Measured pose and velocity and commanded pose in the cell frame; `fx`, `fz` force on the gripper
    beyond its tare [N]; `success` the robot's own rate of commands received in time; the rest are
    flags and the `number` of the last command taken.
    """

    ticks: int
    number: int
    arrival: float
    x: float
    z: float
    pitch: float
    vx: float
    vz: float
    pitch_rate: float
    x_commanded: float
    z_commanded: float
    pitch_commanded: float
    fx: float
    fz: float
    success: float
    moving: int
    expired: int


class Mailbox(SharedMemory, Generic[V]):
    """Value in shared memory with one writer and any readers, none of which blocks another.

    The writer fills the hidden one of two slots, then publishes it. A reader retries only when the
    writer has reused its slot meanwhile, so that a writer that dies during a write blocks no
    reader. Relies on stores that become visible in order, as on x86-64, the only platform of the
    robot's library.
    """

    def __init__(self, kind: type[V], descriptor: int | None = None) -> None:
        """Values of `kind`, a NamedTuple of int and float; by default in new memory."""
        super().__init__(descriptor)
        letters = ("d" if field is float else "q" for field in kind.__annotations__.values())
        self._struct, self._kind = struct.Struct("=" + "".join(letters)), kind
        size, end = self._struct.size, WORD + 2 * self._struct.size
        if descriptor is None:
            os.ftruncate(self.descriptor, end)
        view = memoryview(mmap(self.descriptor, end))
        self._count = view[:WORD].cast("Q")
        self._slots = (view[WORD : WORD + size], view[WORD + size : end])

    def __reduce__(self) -> tuple[Any, ...]:
        return Mailbox, (self._kind, self.descriptor)

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
