"""Franka Hand driver with non-blocking commands and states.

The library's client blocks its whole process while the fingers move and cannot be
interrupted, so the cell speaks the hand's protocol itself.
"""

import socket
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from struct import Struct
from typing import NamedTuple

from drivers.base.errors import Fault
from drivers.base.protocols import Clock
from drivers.base.types import HandState
from drivers.franka.failure import one_line
from drivers.franka.hand_protocol import (
    HEADER,
    PORT,
    PROTOCOL_VERSION,
    STATE_PACKET,
    HandCommand,
    HandStatus,
)
from drivers.franka.settings import HandLimits

SOURCE = "fci hand"
CONNECT_TIMEOUT = 1.0  # s to connect
MOST_DATAGRAMS = 64  # datagrams read at most in one call
UNSTOPPED = 0.25  # s after which a stop that changed nothing is sent again
MOST_STOPS = 3  # stops without effect, after which the hand is given up

NUMBER = Struct("<H")  # a status or a version
NUMBERS = 1 << 32  # of states, then they begin anew
LONGEST_REPLY = 64  # bytes; version 3 sends at most 14

Motion = tuple[HandCommand, tuple[float, ...]]  # a command with its numbers


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply of the hand at the end of command `number`; it has a `version` only for
    CONNECT.
    """

    command: int
    number: int
    status: int
    version: int | None = None


@dataclass(frozen=True, slots=True)
class FingerState:
    """State number `number` that the hand sends: opening `width` and its maximum
    `widest` [m], and the flag `grasped`.
    """

    number: int
    width: float
    widest: float
    grasped: bool


class Links(NamedTuple):
    """Connections to the hand: `tcp` for requests and replies, `udp` for its states."""

    tcp: socket.socket
    udp: socket.socket


class FciHand:
    """Driver of a Franka Hand by its network protocol; no call waits for the fingers.

    Connects at first use, after `ready` was called: in lock-step the fingers move in
    the arm's time. A new command stops the motion in progress and starts once the hand
    confirms its end; a stop without an answer is repeated. `open` homes a hand that has
    not been homed. A strip counts as held by the width at which the fingers rest,
    because the hand may miss thin objects (libfranka#111), and by the hand's flag once
    that was set.
    """

    def __init__(
        self,
        address: str,
        settings: HandLimits,
        clock: Clock,
        ready: Callable[[], object] = lambda: None,
    ) -> None:
        self._address = address
        self._settings = settings
        self._clock = clock
        self._ready = ready
        self._links: Links | None = None
        self._received = bytearray()
        self._number = 0
        self._motion: int | None = None
        # those that wait for the end of the one under way
        self._next: list[Motion] = []
        # state after which the last motion's end was received
        self._ended: int | None = None
        self._stop_sent: float | None = None  # time, until the stopped motion has ended
        self._stops = 0
        self._homed = True  # until the hand reports otherwise
        self._closed = False  # whether the last motion was a grasp that ended
        self._flagged = False  # whether the hand has reported that grasp
        self._fingers = FingerState(
            -1, settings.opening, settings.opening, grasped=False
        )
        self._stamp = 0.0

    def open(self, width: float | None = None) -> None:
        """Start to open the fingers, to `width` [m] or as wide as configured; a hand
        that has not been homed is homed first.
        """
        self._receive()
        limits = self._settings
        motions: list[Motion] = [] if self._homed else [(HandCommand.HOMING, ())]
        goal = limits.opening if width is None else width
        motions.append((HandCommand.MOVE, (goal, limits.speed)))
        self._queue_motions(motions)

    def grasp(self) -> None:
        """Start to close the fingers on the strip's edge; does nothing while they hold
        one.

        Raises Fault `hand_not_homed` where the hand has not been homed.
        """
        self._receive()
        if not self._homed:
            raise Fault(
                "hand_not_homed",
                "the hand does not know its width; `cell open` homes it, in air",
            )
        if not self._holds:
            limits = self._settings
            # a hand that only goes to the width that it is told then presses, too
            thicker = limits.thickest - limits.thinnest
            values = (limits.thinnest, 0.0, thicker, limits.speed, limits.force)
            self._queue_motions([(HandCommand.GRASP, values)])

    def state(self) -> HandState:
        """The newest measured state of the fingers."""
        self._receive()
        return HandState(
            stamp=self._stamp,
            arrival=self._clock.now(),
            source=SOURCE,
            width=self._fingers.width,
            grasped=self._holds and not self._moving,
            moving=self._moving,
        )

    def stop(self) -> None:
        """Stop the fingers' motion; an object that they hold stays held."""
        self._receive()
        self._next = []
        self._interrupt()

    @property
    def _moving(self) -> bool:
        """Whether a motion is in progress, up to the first state after its reply."""
        return self._motion is not None or self._fingers.number == self._ended

    @property
    def _holds(self) -> bool:
        """Whether the fingers rest on an object as thick as a strip since their last
        grasp.
        """
        limits = self._settings
        fingers = self._fingers
        confirmed = fingers.grasped or not self._flagged
        return (
            self._closed
            and limits.thinnest <= fingers.width <= limits.thickest
            and confirmed
        )

    def close(self) -> None:
        """Disconnect from the hand; may be called again."""
        for link in self._links or ():
            link.close()
        self._links = self._motion = self._stop_sent = None
        self._received.clear()

    def _queue_motions(self, motions: list[Motion]) -> None:
        """Start `motions` one after another, once the motion in progress has been
        stopped.
        """
        self._next = motions
        if self._motion is None:
            self._start_next()
        else:
            self._interrupt()

    def _start_next(self) -> None:
        """Request the first of the hand's queued motions."""
        self._closed = self._flagged = False
        self._motion = self._send(self._next.pop(0))

    def _interrupt(self) -> None:
        """Request a stop of the motion in progress, unless one was already
        requested.
        """
        if self._motion is not None and self._stop_sent is None:
            self._send((HandCommand.STOP, ()))
            self._stop_sent = self._clock.now()
            self._stops += 1

    def _repeat_stop(self) -> None:
        """Repeat an overdue stop; Fault `hand_not_stopped` after MOST_STOPS without
        effect.
        """
        if self._stop_sent is None or self._clock.now() - self._stop_sent < UNSTOPPED:
            return
        self._stop_sent = None
        if self._stops >= MOST_STOPS:
            self._stops = 0
            raise Fault(
                "hand_not_stopped",
                f"the hand at {self._address} still moves after {MOST_STOPS} stops;"
                " check it and Desk",
            )
        self._interrupt()

    def _send(self, motion: Motion) -> int:
        """Send the request for `motion` to the hand and return the request's number."""
        links = self._open_links()
        self._number += 1
        command, values = motion
        try:
            links.tcp.sendall(_request(self._number, command, values))
        except OSError as error:
            raise _hand_lost(self._address, error) from error
        return self._number

    def _receive(self) -> None:
        """Read replies and states, repeat a stop without effect; Fault for a malformed
        reply.
        """
        self._ready()
        links = self._open_links()
        with suppress(BlockingIOError):  # once none is left
            for _ in range(MOST_DATAGRAMS):
                self._store_state(_parse_state(links.udp.recv(256)))

        try:
            with suppress(BlockingIOError):
                self._received += _recv(links.tcp)
            replies = _take_replies(self._received)
        except OSError as error:
            raise _hand_lost(self._address, error) from error

        for reply in replies:
            self._finish_motion(reply)

        self._repeat_stop()

    def _store_state(self, fingers: FingerState | None) -> None:
        """Store a state of the fingers that is newer than the last."""
        if fingers is not None and self._is_newer(fingers):
            self._fingers = fingers
            self._stamp = self._clock.now()
            self._homed = fingers.widest > 0
            self._flagged |= self._closed and fingers.grasped

    def _is_newer(self, fingers: FingerState) -> bool:
        """Whether `fingers` came after the last state; a datagram may be late or
        doubled.
        """
        ahead = (fingers.number - self._fingers.number) % NUMBERS
        return 0 < ahead < NUMBERS // 2

    def _finish_motion(self, reply: Reply) -> None:
        """End the motion in progress by its reply and start the next; Fault where it
        failed.
        """
        status = reply.status
        if reply.number != self._motion:
            return

        self._motion = None
        self._ended = self._fingers.number
        self._stop_sent = None
        self._stops = 0
        # of a grasp it may say no more than that nothing of this width is there
        if status == HandStatus.FAIL and reply.command != HandCommand.GRASP:
            self._next = []
            raise Fault(
                "hand_failed", "the hand could not do what it was asked; look at Desk"
            )
        if reply.command == HandCommand.HOMING and status == HandStatus.UNSUCCESSFUL:
            self._next = []
            raise Fault(
                "hand_not_homed", "the hand could not be homed; free its fingers"
            )

        ended = status in (HandStatus.SUCCESS, HandStatus.UNSUCCESSFUL)
        self._closed = ended and reply.command == HandCommand.GRASP
        if self._next:
            self._start_next()

    def _open_links(self) -> Links:
        """Network connections to the hand, opened at the first call; Fault where that
        fails.
        """
        if self._links is None:
            self._ready()
            try:
                self._links, first = _connect(self._address)
            except OSError as error:
                raise _hand_lost(self._address, error) from error
            self._fingers = replace(first, number=first.number - 1)  # it counts anew
            self._store_state(first)
        return self._links


def _connect(address: str) -> tuple[Links, FingerState]:
    """Connect to the hand at `address`; returns the connections and the hand's first
    state.
    """
    with ExitStack() as opened:  # which closes both if anything fails
        udp = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        tcp = opened.enter_context(
            socket.create_connection((address, PORT), CONNECT_TIMEOUT)
        )
        with suppress(OSError):
            tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        udp.bind((tcp.getsockname()[0], 0))
        tcp.sendall(
            _request(0, HandCommand.CONNECT, (PROTOCOL_VERSION, udp.getsockname()[1]))
        )
        received = bytearray()
        while not (answers := _take_replies(received)):
            received += _recv(tcp)

        answer = answers[0]
        if answer.status != HandStatus.SUCCESS:
            raise Fault(
                "hand_version",
                f"the hand at {address} speaks version {answer.version} of its"
                f" interface, the cell speaks {PROTOCOL_VERSION}; update the robot's"
                " system image or the cell",
            )

        udp.settimeout(CONNECT_TIMEOUT)
        while (first := _parse_state(udp.recv(256))) is None:
            continue

        tcp.setblocking(False)
        udp.setblocking(False)
        opened.pop_all()
        return Links(tcp, udp), first


def _recv(tcp: socket.socket) -> bytes:
    """Next bytes from the hand, at least one; ConnectionResetError where it has
    disconnected.
    """
    received = tcp.recv(4096)
    if not received:
        raise ConnectionResetError("it closed the connection")
    return received


def _hand_lost(address: str, error: OSError) -> Fault:
    return Fault(
        "hand_lost",
        f"the hand at {address} does not answer ({one_line(error)}); check it in Desk",
    )


def _request(number: int, command: HandCommand, values: tuple[float, ...]) -> bytes:
    """Message of the hand's protocol: request `number` for `command` with its
    `values`.
    """
    payload = command.layout.pack(*values)
    return HEADER.pack(command, number, HEADER.size + len(payload)) + payload


def _take_replies(received: bytearray) -> list[Reply]:
    """Remove the complete replies from the front of `received` and return them.

    Raises ConnectionError for a reply of invalid size, after which no other can be
    read.
    """
    replies: list[Reply] = []
    version_at = HEADER.size + NUMBER.size  # offset [bytes], behind the status
    while len(received) >= version_at:
        command, number, size = HEADER.unpack_from(received)
        if not version_at <= size <= LONGEST_REPLY:
            raise ConnectionError(f"it sent a reply of {size} bytes")
        if len(received) < size:
            break

        (status,) = NUMBER.unpack_from(received, HEADER.size)
        has_version = size >= version_at + NUMBER.size
        version = NUMBER.unpack_from(received, version_at)[0] if has_version else None
        replies.append(Reply(command, number, status, version))
        del received[:size]
    return replies


def _parse_state(packet: bytes) -> FingerState | None:
    """State of the hand from a datagram; None where the datagram holds none."""
    if len(packet) != STATE_PACKET.size:
        return None
    number, width, widest, grasped, _ = STATE_PACKET.unpack(packet)
    return FingerState(number=number, width=width, widest=widest, grasped=bool(grasped))
