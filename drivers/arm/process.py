"""Processes that own the connection to a robot, and whose end ends its motion."""

import gc
import json
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from drivers.arm.failure import ArmFault, Cause, one_line
from drivers.arm.settings import FciSettings, RealTime
from drivers.clock import lock_memory, take_priority, wake_promptly
from drivers.installation import Installation

ENDING_TIMEOUT = 2.0  # s for the arm to come to rest and the process to end
PRIORITY = 80  # of 1 to 99, above ordinary threads and below the kernel's own

Main = Callable[..., None]


@dataclass(frozen=True, slots=True)
class Task:
    """Arguments of a process that owns a robot, with the `origin` of the clock it shares."""

    address: str
    settings: FciSettings
    installation: Installation
    origin: float | None

    @property
    def lock_step(self) -> bool:
        """Whether the cell drives the robot's time."""
        return self.origin is None


class RobotProcess:
    """The cell's side of a process that owns a robot; every wait has a timeout.

    Messages are JSON. The process sees the end of its pipe when the cell closes or dies, and
    brakes; one that does not end then is killed: its connection closes and the robot stops.
    """

    def __init__(self, main: Main, *given: Any) -> None:
        """Start a process that runs `main(pipe, *given)`."""
        context = get_context("forkserver")
        context.set_forkserver_preload([main.__module__])
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(main, theirs, *given), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def id(self) -> int | None:
        """Process ID."""
        return self._process.pid

    def receive(self, patience: float) -> dict[str, Any]:
        """The next answer, within `patience` [s]; raises ArmFault for a fault or for none."""
        try:
            if not self.pipe.poll(patience):
                raise ArmFault(Cause.SILENT, f"the robot did not answer within {patience:.1f} s")
            answer: dict[str, Any] = json.loads(self.pipe.recv_bytes())
        except (EOFError, OSError):
            self._process.join(ENDING_TIMEOUT)
            code = self._process.exitcode
            words = f"the process of the arm ended by itself, code {code}"
            raise ArmFault(Cause.LOST, words) from None
        if "fault" in answer:
            raise ArmFault.of(answer["fault"])
        return answer

    def end(self) -> None:
        """End the process, at the latest by a kill after ENDING_TIMEOUT; allowed twice."""
        self.pipe.close()
        self._process.join(ENDING_TIMEOUT)
        self.kill()

    def kill(self) -> None:
        """Kill the process, which ends the robot's motion; allowed twice."""
        if self._process.is_alive():
            self._process.kill()
            self._process.join(ENDING_TIMEOUT)


class TerminationFlag:
    """Flag that SIGTERM or SIGHUP sets in this process, so that the arm brakes first.

    A closed terminal or a shutdown asks every process at once. One that died of it in a motion
    would leave it to the robot to notice that its commands stay away.
    """

    def __init__(self) -> None:
        self.is_set = False
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._note_signal)

    def check(self) -> None:
        """Raise ArmFault if this process was asked to end; to be called once the arm rests."""
        if self.is_set:
            raise ArmFault(Cause.ENDED, "the process of the arm was asked to end")

    def _note_signal(self, *_: object) -> None:
        self.is_set = True


def send(pipe: Connection, content: dict[str, Any]) -> None:
    """Send a message through `pipe`, unless the other side is gone."""
    with suppress(OSError):
        pipe.send_bytes(json.dumps(content).encode())


def schedule(mode: RealTime) -> None:
    """Schedule this thread as `fci.realtime` asks; to be called once the library has connected.

    Raises ArmFault where it may not have the real-time priority that is asked for.
    """
    if mode != "ignore":
        lock_memory()
    if mode == "priority" and not take_priority(PRIORITY):
        words = f"this user may not have real-time priority {PRIORITY}, see `ulimit -r`"
        raise ArmFault(Cause.REALTIME, words)
    if mode == "ignore":
        wake_promptly()


def _run(main: Main, pipe: Connection, *given: Any) -> None:
    """Run `main` in this process, which reports its fault, whatever it is, and ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the cell decides when the arm stops
    gc.disable()  # nothing here makes cycles, and a collection takes longer than a tick
    try:
        main(pipe, *given)
    except ArmFault as fault:
        send(pipe, {"fault": fault.content()})
    except Exception as error:  # noqa: BLE001  an edge: the process ends, and with it the motion
        send(pipe, {"fault": ArmFault(Cause.LOST, one_line(error)).content()})
