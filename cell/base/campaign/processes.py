"""Pools of worker processes on this machine, whose calls may be stopped, die, or take
too long.

Processes, not threads: a third of the work holds the GIL.
"""

import gc
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from itertools import starmap
from multiprocessing.connection import Connection, wait
from typing import Any

from drivers.base.child import Child, ChildDied, end_with_parent
from drivers.base.errors import CellError, WorkersLost
from drivers.base.types import Arguments, Calls

POLL_INTERVAL = 0.2  # s between looks at the time that calls take
# key, function, arguments
Waiting = deque[tuple[Any, Callable[..., Any], tuple[Any, ...]]]
TERMINATION_TIMEOUT = 60.0  # s for a call to end once its pool is closed


@dataclass(frozen=True, slots=True)
class Call:
    """Message to a worker process: call `function(*arguments)`, with a StopSignal as
    last argument if it is `stoppable`.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    stoppable: bool = False


class PoolMessage(StrEnum):
    """Messages between a pool and its processes: STOP asks a call to end, READY says
    that the process is prepared.

    A second STOP ends a stoppable call at once.
    """

    STOP = "stop"
    READY = "ready"


@dataclass(frozen=True, slots=True)
class CallResult:
    """Message of a worker process whose call has ended: the `value` that it returned,
    or the CellError that it raised.
    """

    value: Any


class StopSignal:
    """Request to stop a call, which comes through `pipe` or follows from the end of the
    parent process.
    """

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._requests = 0

    def __call__(self) -> bool:
        """Whether this call is to stop; raises KeyboardInterrupt once a second request
        to stop has come.
        """
        while self._pipe.poll():
            try:
                self._pipe.recv()
            # the latter where an answer to the parent was never read
            except (EOFError, OSError):
                return True
            self._requests += 1
            if self._requests > 1:
                raise KeyboardInterrupt
        return self._requests > 0


def work(
    pipe: Connection, prepare: Callable[[], None] | None, dies_with_parent: bool
) -> None:
    """Main function of a worker process: call `prepare`, then carry out calls that come
    through `pipe` until it closes.
    """
    if dies_with_parent:
        end_with_parent(pipe)
    if prepare is not None:
        prepare()
    with suppress(OSError):  # the parent is gone
        pipe.send(PoolMessage.READY)
        call = _next_call(pipe)
        # the libraries' half a million objects, which no collection has to look at
        gc.freeze()
        while True:
            stop = (StopSignal(pipe),) if call.stoppable else ()
            result: Any
            try:
                result = call.function(*call.arguments, *stop)
            except CellError as error:
                result = error
            pipe.send(CallResult(result))
            call = _next_call(pipe)


def _next_call(pipe: Connection) -> Call:
    """Wait for the next call through `pipe` to this worker process; requests to stop
    that come in between are ignored.
    """
    while not isinstance(request := pipe.recv(), Call):
        pass
    return request


@dataclass(slots=True)
class _Running:
    """Call under way in a process; `started_at` [s] is None while the
    process starts.
    """

    key: Any
    process: Child
    started_at: float | None


class ProcessPool:
    """Pool of up to `size` worker processes, started when they are needed and kept for
    later calls.

    Each runs `prepare`, a function known by its name, before its first call. Processes
    that do not die with their parent leave it to a stoppable call to see its end.
    """

    def __init__(
        self,
        size: int,
        prepare: Callable[[], None] | None = None,
        *,
        dies_with_parent: bool = True,
    ) -> None:
        self._size = size
        self._prepare = prepare
        self._dies_with_parent = dies_with_parent
        self._idle: list[Child] = []
        self._running: list[_Running] = []

    @property
    def is_busy(self) -> bool:
        """Whether a call is under way in any process of the pool."""
        return bool(self._running)

    @property
    def has_room(self) -> bool:
        """Whether the pool can begin another call now."""
        return len(self._running) < self._size

    def begin(
        self,
        key: object,
        function: Callable[..., Any],
        *arguments: Any,
        stoppable: bool = False,
    ) -> None:
        """Start `function(*arguments)` in a process; `ended` later yields its result,
        together with `key`.
        """
        if self._idle:
            running = _Running(key, self._idle.pop(), time.monotonic())
        else:
            process = Child(work, self._prepare, self._dies_with_parent)
            running = _Running(key, process, started_at=None)
        self._running.append(running)
        running.process.send(Call(function, arguments, stoppable))

    def carry_out(
        self, waiting: Waiting, limit: float | None = None
    ) -> Iterator[tuple[Any, Any]]:
        """Make all calls in `waiting`, and those added to it meanwhile; yield key and
        result of each as it ends.
        """
        while waiting or self._running:
            while waiting and self.has_room:
                key, function, arguments = waiting.popleft()
                self.begin(key, function, *arguments)
            yield from self.ended(POLL_INTERVAL, limit)

    def ended(
        self, timeout: float, limit: float | None = None
    ) -> Iterator[tuple[Any, Any]]:
        """Wait up to `timeout` [s] for calls to end, and yield the key and the result
        of each that has ended.

        The result is what was returned, the CellError that was raised, ChildDied of a
        process that died, or TimeoutError of a call that took longer than `limit` [s]
        and was killed.
        """
        ready = wait([running.process.pipe for running in self._running], timeout)
        for running in list(self._running):
            if running.process.pipe in ready:
                yield from self._receive(running)
            elif (
                limit is not None
                and running.started_at is not None
                and time.monotonic() > running.started_at + limit
            ):
                self._remove(running)
                reason = f"no outcome after {limit:g} s; its process was ended"
                yield running.key, TimeoutError(reason)

    def stop(self) -> None:
        """Ask the stoppable calls under way to stop; a second time, to stop at once."""
        for running in self._running:
            running.process.send(PoolMessage.STOP)

    def close(self) -> None:
        """Let all processes end: calls that can be stopped stop in an orderly way,
        others may still finish in time.
        """
        processes = self._forget_all()
        for process in processes:
            process.pipe.close()
        for process in processes:
            process.close(TERMINATION_TIMEOUT)

    def kill(self) -> None:
        """End all processes of the pool at once."""
        for process in self._forget_all():
            process.kill()

    def _receive(self, running: _Running) -> Iterator[tuple[Any, Any]]:
        """Yield key and result of the call that `running` has ended; nothing where the
        process only reports that it is ready.
        """
        try:
            message = running.process.receive()
        except ChildDied as died:
            self._remove(running)
            yield running.key, died
            return

        if message is PoolMessage.READY:
            running.started_at = time.monotonic()
            return

        self._running.remove(running)
        self._idle.append(running.process)
        yield running.key, message.value

    def _remove(self, running: _Running) -> None:
        self._running.remove(running)
        running.process.kill()

    def _forget_all(self) -> list[Child]:
        processes = [*self._idle, *(running.process for running in self._running)]
        self._idle = []
        self._running = []
        return processes


@contextmanager
def workers(jobs: int) -> Iterator[Calls]:
    """Open a function that carries out calls in `jobs` processes, or in this process if
    `jobs` is 1.

    For work that keeps its own journal: raises WorkersLost when a process dies.
    """
    if jobs == 1:
        yield lambda function, calls: enumerate(starmap(function, calls))
        return
    pool = ProcessPool(jobs)
    try:
        yield partial(_results, pool)
    finally:
        pool.kill()


def _results(
    pool: ProcessPool, function: Callable[..., Any], calls: Arguments
) -> Iterator[tuple[int, Any]]:
    waiting = deque((number, function, call) for number, call in enumerate(calls))
    for number, result in pool.carry_out(waiting):
        if isinstance(result, ChildDied):
            raise WorkersLost(f"a worker process died: {result}")
        if isinstance(result, CellError):
            raise result
        yield number, result


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0))
