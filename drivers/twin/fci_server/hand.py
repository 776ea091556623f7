"""The emulated hand: two fingers that close on an object, one command at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from drivers.base.motion import TICK
from drivers.franka.hand_protocol import STATE_PACKET, HandCommand, HandStatus
from drivers.twin.fci_server.wire import HAND_FRAMING, ClientRequest

WIDEST = 0.08  # m
FASTEST_FINGER = 0.1  # m/s, of one finger towards the other
TEMPERATURE = 30  # degrees C

Between = Callable[[], float | None]
HandRequest = ClientRequest[HandCommand]


@dataclass(slots=True)
class FingerMotion:
    """Motion of the emulated hand's fingers at `request`: the `widths` [m] still to
    reach in turn, at `speed` [m/s].
    """

    request: HandRequest
    widths: list[float]
    speed: float


class EmulatedHand:
    """Emulated hand, stepped every 1 ms: width [m] between its fingers, and the object
    they hold.

    `between` gives the thickness [m] of the object between the fingers now, None for
    nothing. Speeds above FASTEST_FINGER are limited to it; the real hand's answer in
    that case is not known. Without `is_homed` it reports no width and refuses to move.
    It holds objects thinner than `felt` [m] without reporting a grasp, and ignores the
    next `deaf` stops, as users report (franka_ros#276, libfranka#111, #28).
    """

    def __init__(self, between: Between) -> None:
        self._between = between
        self._motion: FingerMotion | None = None
        self.width = WIDEST
        self.is_homed = True
        self.felt = 0.0
        self.deaf = 0
        self.is_grasped = False
        self.replies: list[bytes] = []

    @property
    def moving(self) -> bool:
        """Whether the fingers are executing a command."""
        return self._motion is not None

    def state(self, time: int) -> bytes:
        """Bytes of the datagram with the hand's state at `time` [ms] of the robot's
        clock.
        """
        widths = (self.width, WIDEST) if self.is_homed else (0.0, 0.0)
        return STATE_PACKET.pack(
            time & 0xFFFFFFFF, *widths, self.is_grasped, TEMPERATURE
        )

    def begin(self, request: HandRequest) -> None:
        """Start the hand's command in `request` and abort the one in progress."""
        is_stop = request.command is HandCommand.STOP
        if is_stop and self.deaf > 0:
            self.deaf -= 1
            return
        self.interrupt()
        if is_stop:
            self._answer(request, HandStatus.SUCCESS)
        elif not _valid(request) or not (
            self.is_homed or request.command is HandCommand.HOMING
        ):
            self._answer(request, HandStatus.FAIL)
        else:
            self.is_grasped = False
            self._motion = _finger_motion(request)

    def interrupt(self) -> None:
        """Abort the hand's command in progress; the fingers stop where they are."""
        if self._motion is not None:
            self._answer(self._motion.request, HandStatus.ABORTED)
            self._motion = None

    def advance(self) -> None:
        """Advance the fingers by one millisecond."""
        if self.is_grasped and self._between() is None:
            self.is_grasped = False
            self.width = 0.0  # simplified: the fingers close at once

        motion = self._motion
        if motion is None:
            return

        target = motion.widths[0]
        step = TICK * motion.speed
        if target >= self.width:
            self.width = min(self.width + step, target)
        elif self._close_to(max(self.width - step, target)):
            self._stop_on_touch(motion)
            return

        if self.width == target:
            self._reach_width(motion)

    def _close_to(self, width: float) -> bool:
        """Close to `width` [m] or onto an object in between; returns whether one was
        touched.
        """
        thickness = self._between()
        if thickness is None or width > thickness:
            self.width = width
            return False
        self.width = min(thickness, WIDEST)
        return True

    def _stop_on_touch(self, motion: FingerMotion) -> None:
        """End `motion`, as the fingers have touched the object between them."""
        self._motion = None
        status = HandStatus.UNSUCCESSFUL
        if motion.request.command is HandCommand.GRASP:
            width, inner, outer = motion.request.values[:3]
            inside = width - inner <= self.width <= width + outer
            self.is_grasped = inside and self.width >= self.felt
            if self.is_grasped:
                status = HandStatus.SUCCESS
        self._answer(motion.request, status)

    def _reach_width(self, motion: FingerMotion) -> None:
        """Let the fingers go on to the next width of `motion`, or end it after the last
        one.
        """
        motion.widths.pop(0)
        if motion.widths:
            return
        self._motion = None
        # closed without touching anything
        missed = motion.request.command is HandCommand.GRASP
        self.is_homed = self.is_homed or motion.request.command is HandCommand.HOMING
        self._answer(
            motion.request, HandStatus.UNSUCCESSFUL if missed else HandStatus.SUCCESS
        )

    def _answer(self, request: HandRequest, status: HandStatus) -> None:
        content = HAND_FRAMING.status.pack(status)
        self.replies.append(
            HAND_FRAMING.reply(request.command, request.command_id, content)
        )


def _finger_motion(request: HandRequest) -> FingerMotion:
    """Motion of the fingers that `request` starts, which asks for homing, a grasp or a
    move to a width.
    """
    if request.command is HandCommand.HOMING:
        return FingerMotion(request, [0.0, WIDEST], FASTEST_FINGER)
    if request.command is HandCommand.GRASP:
        return FingerMotion(request, [0.0], min(request.values[3], FASTEST_FINGER))
    width, speed = request.values
    return FingerMotion(request, [width], min(speed, FASTEST_FINGER))


def _valid(request: HandRequest) -> bool:
    """Whether `request` asks for a motion of the fingers, with numbers that the hand
    accepts.
    """
    values: tuple[float, ...] = request.values
    if not all(map(isfinite, values)):
        return False
    if request.command is HandCommand.GRASP:
        width, inner, outer, speed, force = values
        return 0 <= width <= WIDEST and min(inner, outer) >= 0 < speed and force > 0
    if request.command is HandCommand.MOVE:
        width, speed = values
        return 0 <= width <= WIDEST and speed > 0
    return request.command is HandCommand.HOMING
