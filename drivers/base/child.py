"""Child process: start, messages, supervision and end; every wait for it has a timeout.

Parent and child exchange messages, one frozen dataclass for each kind, over a pipe;
images go through shared memory. `subprocess`, not `multiprocessing.Process`: a worker
of Dask is a daemon, which may not have children of that kind.
"""

import math
import os
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from mmap import mmap
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from drivers.base.types import Image

BOOT = "import sys; from drivers.base.child import serve; serve(int(sys.argv[1]))"
# of linear algebra: one
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
STALL_TIMEOUT = 5  # s without progress in the middle of a message
TERMINATION_TIMEOUT = 1.0  # s from SIGTERM to SIGKILL
KILL_TIMEOUT = 10.0  # s for the kernel to end a killed process


@dataclass(frozen=True, slots=True)
class MainCall:
    """First message to a child process: run `main(pipe, *arguments)`, then end."""

    main: Callable[..., None]
    arguments: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Failure:
    """Last message of a child process: class and text of an error of its main
    function.
    """

    error: str
    text: str


class ChildDied(Exception):
    """Error of a child process that has ended, by an error (`failure`) or with exit
    `code`.

    The code of a process that a signal ended is the signal's number, negated.
    """

    def __init__(self, code: int | None, failure: Failure | None) -> None:
        reason = "" if failure is None else f"{failure.error}: {failure.text}"
        super().__init__(reason or f"it ended by itself, code {code}")
        self.code = code
        self.failure = failure


class SharedMemory:
    """Memory shared by a parent and a child process, passed to the child as an
    argument.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self.descriptor = (
            os.memfd_create("shared") if descriptor is None else descriptor
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.descriptor,)

    def close(self) -> None:
        """Close the shared memory's file descriptor; mapped parts stay usable."""
        os.close(self.descriptor)


class SharedImage(SharedMemory):
    """Image in memory shared by a parent and its child process.

    One side uses it at a time, and hands it over by a message, so that no image is
    torn.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        super().__init__(descriptor)
        self._pixels: Image = np.empty(0, np.uint8)

    def write(self, image: Image) -> None:
        """Copy `image` (h, w, 3) into the shared memory, which grows where it is too
        small.
        """
        if image.nbytes > self._pixels.size:
            os.ftruncate(self.descriptor, image.nbytes)
        np.copyto(self._view(image.shape), image)

    def read(self, shape: tuple[int, ...]) -> Image:
        """Read-only view (h, w, 3) of the last written image, whose `shape` must be
        given.
        """
        view = self._view(shape)
        view.setflags(write=False)
        return view

    def _view(self, shape: tuple[int, ...]) -> Image:
        size = math.prod(shape)
        if size > self._pixels.size:
            self._pixels = np.frombuffer(mmap(self.descriptor, size), np.uint8)
        return self._pixels[:size].reshape(shape)


class Child:
    """Child process that runs `main(pipe, *arguments)`, a function of a module.

    It ignores Ctrl-C, which its parent handles. Its pipe closes when the parent closes
    it or dies, and the main function must then return; `end_with_parent` ends one that
    computes for long.
    """

    def __init__(self, main: Callable[..., None], *arguments: Any) -> None:
        """Start the child process `main`; it shares any SharedMemory among the
        `arguments`.
        """
        self._failure: Failure | None = None
        self.pipe, theirs = Pipe()
        timeout = struct.pack("ll", STALL_TIMEOUT, 0)  # s, us
        with socket.socket(fileno=os.dup(self.pipe.fileno())) as end:
            # a stopped child blocks both
            for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
                end.setsockopt(socket.SOL_SOCKET, option, timeout)

        name = f"{main.__module__}.{main.__qualname__}"
        shared = [
            value.descriptor for value in arguments if isinstance(value, SharedMemory)
        ]
        paths = os.pathsep.join(path for path in sys.path if path)
        environment = {**dict.fromkeys(THREADS, "1"), **os.environ, "PYTHONPATH": paths}
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603  this very interpreter
                [sys.executable, "-P", "-c", BOOT, str(theirs.fileno()), name],
                pass_fds=[theirs.fileno(), *shared],
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                env=environment,
            )
        self.send(MainCall(main, arguments))

    @property
    def pid(self) -> int:
        """Process ID of the child process."""
        return self._process.pid

    @property
    def ends(self) -> bool:
        """Whether the child has ended or is about to end; its messages can still be
        received.

        A killed process first frees its memory, for some 10 ms, and only then closes
        its pipe.
        """
        if self._process.poll() is not None:
            return True
        with suppress(OSError):
            return Path(f"/proc/{self.pid}/statm").read_bytes().startswith(b"0 ")
        return False

    def send(self, message: object) -> None:
        """Send the child a `message`; only `receive` reports that the child has
        ended.
        """
        with suppress(OSError):
            self.pipe.send(message)

    def receive(self, timeout: float | None = None) -> Any:
        """Next message of the child; None where none comes within `timeout` [s].

        Raises ChildDied once the child has failed or ended and all its messages were
        received. A child that failed may take a moment to end, for which `close` waits.
        """
        try:
            if not self.pipe.poll(timeout):
                return None
            message = self.pipe.recv()
        except (EOFError, OSError):
            message = None
        if message is None or isinstance(message, Failure):
            self._failure = self._failure or message
            if self._failure is None:
                self.close()
            raise ChildDied(self._process.returncode, self._failure)
        return message

    def close(self, patience: float = 1.0) -> None:
        """Close the pipe to the child and wait until the child has ended; allowed
        twice.

        It gets SIGTERM after `patience` [s], and SIGKILL after TERMINATION_TIMEOUT
        more.
        """
        self.pipe.close()
        if not self._has_ended(patience):
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGTERM)
            if not self._has_ended(TERMINATION_TIMEOUT):
                self.kill()

    def kill(self) -> None:
        """Kill the child process and the processes that it started."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)
        self._has_ended(KILL_TIMEOUT)
        self.pipe.close()

    def _has_ended(self, timeout: float) -> bool:
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return False
        return True


def end_with_parent(pipe: Connection) -> None:
    """Kill this child process and those it started once its parent closes `pipe` or has
    died.
    """
    Thread(target=_watch_parent, args=(pipe.fileno(),), daemon=True).start()


def serve(descriptor: int) -> None:
    """Run, in the child process, the MainCall that comes through the pipe
    `descriptor`.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = Connection(descriptor)
    try:
        call: MainCall = pipe.recv()
        call.main(pipe, *call.arguments)
    except EOFError:
        return
    except Exception as error:  # noqa: BLE001  an edge: the parent says why the child has ended
        with suppress(OSError):
            pipe.send(Failure(type(error).__name__, str(error)))


def _watch_parent(descriptor: int) -> None:
    """Wait until the other end of the pipe `descriptor` is closed, then kill this
    process group.
    """
    watch = select.poll()
    watch.register(descriptor, 0)  # its end alone
    watch.poll()
    with suppress(PermissionError):
        os.killpg(0, signal.SIGKILL)
