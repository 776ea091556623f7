"""Worker process that calls functions sent to it, so that a crash leaves this process alive.

Not `multiprocessing`: a Dask worker is a daemon, which may have no such children.
"""

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any

from drivers.errors import CellError

STOP = "stop"
POLL_INTERVAL = 0.5  # s between looks at whether the parent lives
TERMINATION_TIMEOUT = 60.0  # s that a call may take to end once it was asked to stop
BOOT = "import sys; from cell.campaign.worker import serve; serve(int(sys.argv[1]))"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Call = Callable[..., Any]


class Died(Exception):
    """Error of a worker process that ended by itself, with its exit code, negative for a signal."""


class Worker:
    """Worker process that ignores Ctrl-C; its parent stops it through the pipe or by force."""

    def __init__(self) -> None:
        """Start the process, idle; one thread for linear algebra."""
        self.pipe, theirs = Pipe()
        paths = os.pathsep.join(path for path in sys.path if path)
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603  this very interpreter
                [sys.executable, "-c", BOOT, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                env={**dict.fromkeys(THREADS, "1"), **os.environ, "PYTHONPATH": paths},
            )

    @property
    def pid(self) -> int:
        """Process ID of the worker."""
        return self._process.pid

    def begin(self, function: Call, *arguments: Any) -> None:
        """Start `function(*arguments, stop)`; `stop` is a StopSignal."""
        with suppress(OSError):  # it has ended by itself, and `result` will say so
            self.pipe.send((function, arguments))

    def result(self) -> Any:
        """Wait for and return what the call returned, or the CellError it raised; raises Died."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            raise Died(self._process.wait()) from None

    def stop(self) -> None:
        """Ask the running call to stop; a second time, to stop at once."""
        with suppress(OSError):
            self.pipe.send(STOP)

    def release(self) -> None:
        """Close the pipe; a call that watches its StopSignal stops under control."""
        self.pipe.close()

    def kill(self) -> None:
        """End the process at once, with what it started."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self.pipe.close()

    def join(self) -> None:
        """Wait for a released process to end; it is ended where it takes too long."""
        try:
            self._process.wait(TERMINATION_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.kill()


class StopSignal:
    """Signal that a call must stop: requested through `pipe`, or because the parent is gone."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._words = 0

    def __call__(self) -> bool:
        """Whether a stop was requested; raises KeyboardInterrupt from the second request on."""
        while self._pipe.poll():
            try:
                self._pipe.recv()
            except EOFError:
                return True
            self._words += 1
            if self._words > 1:
                raise KeyboardInterrupt
        return self._words > 0


def serve(descriptor: int) -> None:
    """Run as the worker process: call what comes through the pipe until it closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = Connection(descriptor)
    with suppress(OSError):  # nobody waits for the result any more
        task = _next_call(pipe)
        gc.freeze()  # the libraries' half a million objects, which no collection has to look at
        while task is not None:
            pipe.send(_call(*task, StopSignal(pipe)))
            task = _next_call(pipe)


def _call(function: Call, arguments: tuple[Any, ...], stop: StopSignal) -> Any:
    try:
        return function(*arguments, stop)
    except CellError as error:
        return error


def _next_call(pipe: Connection) -> tuple[Call, tuple[Any, ...]] | None:
    """Wait for the next call; None at the end. Stop requests between calls are ignored."""
    while True:
        try:
            word: tuple[Call, tuple[Any, ...]] | str = pipe.recv()
        except EOFError:
            return None
        if not isinstance(word, str):
            return word


def end_with_parent() -> None:
    """End this process and what it started soon after its parent is gone."""
    Thread(target=_watch_parent, args=(os.getppid(),), daemon=True).start()


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(POLL_INTERVAL)
    with suppress(PermissionError):
        os.killpg(0, signal.SIGKILL)
