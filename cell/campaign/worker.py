"""Worker process that calls functions sent to it, so that a crash leaves this process alive."""

import gc
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from drivers.child import Child, end_with_parent
from drivers.errors import CellError

TERMINATION_TIMEOUT = 60.0  # s for a call to end after a request to stop


@dataclass(frozen=True, slots=True)
class Call:
    """Request to call `function(*arguments, stop)` with a StopSignal."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Stop:
    """Request to stop the call under way; a second one, to stop it at once."""


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a call: its return value, or the CellError that it raised."""

    value: Any


class Worker:
    """Worker process; its parent stops a call through the pipe or by force."""

    def __init__(self, *, dies_with_parent: bool = False) -> None:
        """Start the process, idle; a call that watches its StopSignal sees its parent's end too."""
        self._child = Child(work, dies_with_parent)

    @property
    def pipe(self) -> Connection:
        """Pipe that is ready once the call has ended, or the process."""
        return self._child.pipe

    def begin(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Start `function(*arguments, stop)`; `stop` is a StopSignal."""
        self._child.send(Call(function, arguments))

    def result(self) -> Any:
        """Wait for and return what the call returned, or the CellError it raised.

        Raises ChildDied where the process has ended by itself.
        """
        return self._child.receive().value

    def stop(self) -> None:
        """Ask the running call to stop; a second time, to stop at once."""
        self._child.send(Stop())

    def release(self) -> None:
        """Close the pipe; a call that watches its StopSignal stops under control."""
        self.pipe.close()

    def kill(self) -> None:
        """Kill the process and its children."""
        self._child.kill()

    def join(self) -> None:
        """Wait for a released process to end; it is ended where it takes too long."""
        self._child.close(TERMINATION_TIMEOUT)


class StopSignal:
    """Signal that a call must stop: requested through `pipe`, or because the parent is gone."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._requests = 0

    def __call__(self) -> bool:
        """Whether a stop was requested; raises KeyboardInterrupt from the second request on."""
        while self._pipe.poll():
            try:
                self._pipe.recv()
            except EOFError:
                return True
            self._requests += 1
            if self._requests > 1:
                raise KeyboardInterrupt
        return self._requests > 0


def work(pipe: Connection, dies_with_parent: bool) -> None:
    """Run in the process: carry out the calls that arrive through the pipe until it closes."""
    if dies_with_parent:
        end_with_parent(pipe)
    with suppress(OSError):  # the parent is gone
        call = _next_call(pipe)
        gc.freeze()  # the libraries' half a million objects, which no collection has to look at
        while True:
            pipe.send(Result(_call(call, StopSignal(pipe))))
            call = _next_call(pipe)


def _call(call: Call, stop: StopSignal) -> Any:
    try:
        return call.function(*call.arguments, stop)
    except CellError as error:
        return error


def _next_call(pipe: Connection) -> Call:
    """Wait for the next call; stop requests between calls are ignored."""
    while not isinstance(request := pipe.recv(), Call):
        pass
    return request
