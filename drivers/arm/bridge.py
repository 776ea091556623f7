"""Connection to the process that owns the robot: starts it, supervises it, ends it."""

from contextlib import suppress
from multiprocessing import get_context
from typing import Any

from drivers.arm.failure import Cause, Failure, decode, encode
from drivers.arm.joint_log import joint_rows
from drivers.arm.latest import Latest, allocate
from drivers.arm.messages import ORDER_LAYOUT, REPORT_LAYOUT, Kind, Order, Report
from drivers.arm.process import Task, run
from drivers.errors import Fault

ENDING_TIMEOUT = 1.5  # s for the arm to come to rest and the process to end
SENDING = 20.0  # s for the log of the joints, which is sent once the arm rests
TICKS_PER_ANSWER = 50  # in lock-step: many ticks take a busy machine longer than an answer may


class Bridge:
    """Connection to a process that owns one robot; every wait has a timeout.

    A process that does not answer is killed: its connection closes and the robot stops. After a
    failure every call raises the same Fault.
    """

    def __init__(self, task: Task) -> None:
        """Start the process and wait until it controls the robot; raises Fault where that fails."""
        context = get_context("forkserver")
        context.set_forkserver_preload([__name__])
        orders, reports = (allocate(layout, context) for layout in (ORDER_LAYOUT, REPORT_LAYOUT))
        self._task = task
        self._orders = Latest(orders, Order, ORDER_LAYOUT)
        self._reports = Latest(reports, Report, REPORT_LAYOUT)
        self._order = Order(0, Kind.HOLD, 0, 0.0, 0.0, 0.0)
        self._failure: Failure | None = None
        self._ended = False
        self.ticks = 0
        self.timing: dict[str, Any] = {}
        self.joints = joint_rows(b"")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=run, args=(task, theirs, orders, reports), daemon=True
        )
        self._process.start()
        theirs.close()
        self._receive_answer(task.settings.start)

    @property
    def lock_step(self) -> bool:
        """Whether the cell drives the robot's time."""
        return self._task.lock_step

    @property
    def process(self) -> int | None:
        """Process ID of the process that owns the robot."""
        return self._process.pid

    def order(self, kind: Kind, a: float = 0.0, b: float = 0.0, c: float = 0.0) -> None:
        """Replace the command that the loop follows."""
        self.check()
        last = self._order
        self._order = Order(last.number + 1, kind, last.beat + 1, a, b, c)
        self._orders.write(self._order)

    def beat(self) -> None:
        """Send a heartbeat, by which the loop knows that the cell runs."""
        self._order = self._order._replace(beat=self._order.beat + 1)
        self._orders.write(self._order)

    def advance(self, until: int) -> None:
        """In lock-step, run all ticks of the robot up to number `until`."""
        self.check()
        first = self.ticks + TICKS_PER_ANSWER
        for tick in (*range(first, until, TICKS_PER_ANSWER), until):
            with suppress(OSError):  # it has ended, and the answer will say so
                self._pipe.send_bytes(encode({"until": tick}))
            self._receive_answer(self._task.settings.answer)
            self.ticks = tick

    def report(self) -> tuple[Report, bool]:
        """Newest report of the control loop, and whether it has yet to take the last command."""
        self.check()
        report = self._reports.read()
        return report, report.number != self._order.number

    def check(self) -> None:
        """Raise the Fault with which the robot has stopped, if it has."""
        if self._failure is None and not self._ended and self._pipe.poll():
            self._receive_answer(0.0)
        if self._failure is not None:
            raise self._failure.fault()

    def close(self) -> None:
        """Bring the arm to rest and end the process; allowed twice and after a failure."""
        if self._ended:
            return
        self._ended = True
        if self._failure is None:
            with suppress(OSError, EOFError, Fault):
                self._pipe.send_bytes(encode({"close": True}))
                self._receive_answer(ENDING_TIMEOUT)
                if self._pipe.poll(SENDING):
                    self.joints = joint_rows(self._pipe.recv_bytes())
        self._process.join(ENDING_TIMEOUT)
        self._kill()
        self._pipe.close()

    def _receive_answer(self, patience: float) -> None:
        """Receive one answer of the process within `patience` [s]."""
        try:
            if not self._pipe.poll(patience):
                self._fail(Cause.SILENT, f"the robot did not answer within {patience:.1f} s")
            answer = decode(self._pipe.recv_bytes())
        except (EOFError, OSError):
            self._process.join(ENDING_TIMEOUT)
            code = self._process.exitcode
            self._fail(Cause.LOST, f"the process of the arm ended by itself, code {code}")
        self.timing = answer.get("timing", self.timing)
        if "failure" in answer:
            self._failure = Failure.of(answer["failure"])
            raise self._failure.fault()

    def _fail(self, cause: Cause, words: str) -> None:
        self._failure = Failure(cause, words)
        self._kill()
        raise self._failure.fault()

    def _kill(self) -> None:
        if self._process.is_alive():
            self._process.kill()
            self._process.join(ENDING_TIMEOUT)
