"""Shared memory that holds the newest command to the robot's loop, or the loop's newest
report.
"""

import os
import struct
from enum import IntEnum
from mmap import mmap
from typing import Any, Generic, NamedTuple, TypeVar

from drivers.base.child import SharedMemory
from drivers.base.errors import Fault

WORD = 8  # bytes
TRIES = 1000

V = TypeVar("V", bound=NamedTuple)


class CommandKind(IntEnum):
    """Kinds of commands to the robot's loop: brake, move at a velocity, or move to a
    pose.
    """

    HOLD = 0
    FOLLOW = 1
    MOVE = 2


class LoopCommand(NamedTuple):
    """Command to the robot's loop: its `kind`, and `x`, `z`, `pitch` of a pose or a
    velocity.

    `number` rises with each command, which the loop executes once; `beat` counts
    heartbeats.
    """

    number: int
    kind: int
    beat: int
    x: float
    z: float
    pitch: float


class Report(NamedTuple):
    """State of the arm after `ticks` of its motion, which arrived at time `arrival`
    [s].

    Measured pose and velocity and commanded pose in the cell frame [m, rad, s]; `fx`,
    `fz` force on the gripper less its tare [N]; `number` of the last command taken;
    flags `moving` and `expired`, a velocity not renewed.
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
    moving: int
    expired: int


class Mailbox(SharedMemory, Generic[V]):
    """Value in shared memory, written by one process and read by others without any
    locking.

    The writer fills the hidden one of two slots, then publishes it. A reader retries
    only when the writer has reused its slot meanwhile, so that a writer that dies
    during a write blocks no reader. Relies on stores that become visible in order, as
    on x86-64, the only platform of the robot's library.
    """

    def __init__(self, kind: type[V], descriptor: int | None = None) -> None:
        """Mailbox for values of `kind`, a NamedTuple of int and float; by default in
        new memory.
        """
        super().__init__(descriptor)
        letters = (
            "d" if field is float else "q" for field in kind.__annotations__.values()
        )
        self._struct = struct.Struct("=" + "".join(letters))
        self._kind = kind
        middle = WORD + self._struct.size
        end = middle + self._struct.size
        if descriptor is None:
            os.ftruncate(self.descriptor, end)

        view = memoryview(mmap(self.descriptor, end))
        self._count = view[:WORD].cast("Q")
        self._slots = view[WORD:middle], view[middle:end]

    def __reduce__(self) -> tuple[Any, ...]:
        return Mailbox, (self._kind, self.descriptor)

    @property
    def count(self) -> int:
        """Number of values that have been written into the mailbox."""
        return self._count[0]

    def write(self, value: V) -> None:
        """Publish `value` as the mailbox's newest one."""
        after = self._count[0] + 1
        self._struct.pack_into(self._slots[after & 1], 0, *value)
        self._count[0] = after

    def read(self) -> V:
        """Newest value, zeros before the first write; Fault `arm_memory` after TRIES
        attempts.
        """
        for _ in range(TRIES):
            before = self._count[0]
            content = bytes(self._slots[before & 1])
            if self._count[0] == before:
                return self._kind._make(self._struct.unpack_from(content))
        raise Fault("arm_memory", "the arm's process writes faster than it can be read")


class CommandInbox:
    """Reader of the cell's commands, which takes each once and measures the time since
    the cell's last heartbeat.

    `number` is that of the last command taken.
    """

    def __init__(self, commands: Mailbox[LoopCommand]) -> None:
        self._commands = commands
        self.number = commands.read().number
        self._beat = 0  # last heartbeat of the cell
        self._heard_at = 0.0  # its robot time [s]

    def take(self, time: float) -> LoopCommand | None:
        """Newest command of the cell at robot `time` [s]; None where it was taken
        before.
        """
        command = self._commands.read()
        if command.beat != self._beat:
            self._beat = command.beat
            self._heard_at = time
        if command.number == self.number:
            return None
        self.number = command.number
        return command

    def silence(self, time: float) -> float:
        """Time [s] without a heartbeat of the cell at robot `time` [s]; 0 before the
        first heartbeat.
        """
        return time - self._heard_at if self._beat else 0.0
