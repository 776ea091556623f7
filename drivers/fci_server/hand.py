"""The emulated hand: two fingers that close on an object, one command at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from drivers.fci_server.wire import HAND_FRAMING, Request
from drivers.franka.hand_protocol import PAYLOAD, STATE_PACKET, HandCommand, HandStatus
from drivers.motion import TICK

WIDEST = 0.08  # m
FASTEST_FINGER = 0.1  # m/s, of one finger towards the other
TEMPERATURE = 30  # degrees C

Between = Callable[[], float | None]
HandRequest = Request[HandCommand]


@dataclass(slots=True)
class Task:
    """A command under way: widths [m] still to reach in turn, at a speed [m/s]."""

    request: HandRequest
    widths: list[float]
    speed: float


class Hand:
    """Emulated hand, stepped every 1 ms: width [m] between its fingers, and the object they hold.

    `between` gives the thickness [m] of the object between the fingers now, None for nothing.
    Speeds above FASTEST_FINGER are limited to it; the real hand's answer in that case is not known.
    Without `is_homed` it reports no width and refuses to move. It holds objects thinner than `felt`
    [m] without reporting a grasp, and ignores the next `deaf` stops, as users report
    (franka_ros#276, libfranka#111, #28).
    """

    def __init__(self, between: Between) -> None:
        self._between = between
        self._task: Task | None = None
        self.width = WIDEST
        self.is_homed = True
        self.felt = 0.0
        self.deaf = 0
        self.is_grasped = False
        self.replies: list[bytes] = []

    @property
    def moving(self) -> bool:
        """Whether a command is under way."""
        return self._task is not None

    def state(self, time: int) -> bytes:
        """Datagram of the hand's state at robot `time` [ms]."""
        width, widest = (self.width, WIDEST) if self.is_homed else (0.0, 0.0)
        return STATE_PACKET.pack(time & 0xFFFFFFFF, width, widest, self.is_grasped, TEMPERATURE)

    def begin(self, request: HandRequest) -> None:
        """Start the command of `request`; one that is under way is aborted."""
        if request.command is HandCommand.STOP and self.deaf > 0:
            self.deaf -= 1
            return
        self.interrupt()
        if request.command is HandCommand.STOP:
            self._answer(request, HandStatus.SUCCESS)
        elif not _valid(request) or not (self.is_homed or request.command is HandCommand.HOMING):
            self._answer(request, HandStatus.FAIL)
        else:
            self.is_grasped = False
            self._task = _task(request)

    def interrupt(self) -> None:
        """Abort the command under way, with the fingers where they are."""
        if self._task is not None:
            self._answer(self._task.request, HandStatus.ABORTED)
            self._task = None

    def advance(self) -> None:
        """Advance the fingers by one millisecond."""
        if self.is_grasped and self._between() is None:
            self.is_grasped, self.width = (
                False,
                0.0,
            )  # simplified: they close at once
        task = self._task
        if task is None:
            return
        target, step = task.widths[0], TICK * task.speed
        if target >= self.width:
            self.width = min(self.width + step, target)
        elif self._close_to(max(self.width - step, target)):
            self._stop_on_touch(task)
            return
        if self.width == target:
            self._reach_width(task)

    def _close_to(self, width: float) -> bool:
        """Close to `width` [m] or onto the object between the fingers; returns if they met it."""
        thickness = self._between()
        touched = thickness is not None and width <= thickness
        self.width = min(thickness, WIDEST) if thickness is not None and touched else width
        return touched

    def _stop_on_touch(self, task: Task) -> None:
        """End `task`, whose fingers have met the object between them."""
        self._task = None
        status = HandStatus.UNSUCCESSFUL
        if task.request.command is HandCommand.GRASP:
            width, inner, outer = _values(task.request)[:3]
            inside = width - inner <= self.width <= width + outer
            self.is_grasped = inside and self.width >= self.felt
            status = HandStatus.SUCCESS if self.is_grasped else HandStatus.UNSUCCESSFUL
        self._answer(task.request, status)

    def _reach_width(self, task: Task) -> None:
        """Start the next width of `task`, or end `task` after its last."""
        task.widths.pop(0)
        if task.widths:
            return
        self._task = None
        missed = task.request.command is HandCommand.GRASP  # closed without touching anything
        self.is_homed = self.is_homed or task.request.command is HandCommand.HOMING
        self._answer(task.request, HandStatus.UNSUCCESSFUL if missed else HandStatus.SUCCESS)

    def _answer(self, request: HandRequest, status: HandStatus) -> None:
        content = HAND_FRAMING.status.pack(status)
        self.replies.append(HAND_FRAMING.reply(request.command, request.command_id, content))


def _task(request: HandRequest) -> Task:
    if request.command is HandCommand.HOMING:
        return Task(request, [0.0, WIDEST], FASTEST_FINGER)
    if request.command is HandCommand.GRASP:
        return Task(request, [0.0], min(_values(request)[3], FASTEST_FINGER))
    return Task(request, [_values(request)[0]], min(_values(request)[1], FASTEST_FINGER))


def _valid(request: HandRequest) -> bool:
    values = _values(request)
    if not all(isfinite(value) for value in values):
        return False
    if request.command is HandCommand.GRASP:
        width, inner, outer, speed, force = values
        return 0 <= width <= WIDEST and min(inner, outer) >= 0 < speed and force > 0
    if request.command is HandCommand.MOVE:
        width, speed = values
        return 0 <= width <= WIDEST and speed > 0
    return request.command is HandCommand.HOMING


def _values(request: HandRequest) -> tuple[float, ...]:
    """Numbers of a request, in the order of the hand's protocol."""
    return PAYLOAD[request.command].unpack(request.payload)
