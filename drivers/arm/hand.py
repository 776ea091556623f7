"""Franka Hand driver with non-blocking commands and states."""

import socket
from collections.abc import Callable
from contextlib import suppress

from drivers.arm import hand_wire as wire
from drivers.arm.failure import one_line
from drivers.arm.settings import HandLimits
from drivers.errors import Fault
from drivers.protocols import Clock
from drivers.types import HandState

SOURCE = "fci hand"
PATIENCE = 1.0  # s to connect
STALE = 64  # datagrams taken at once


class FciHand:
    """Satisfies `drivers.protocols.Hand` over the hand's own protocol.

    Connects at first use, after `ready` was called: in lock-step the fingers move in the arm's
    time. A motion under way is stopped before another begins.
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
        self._tcp: socket.socket | None = None
        self._udp: socket.socket | None = None
        self._received = bytearray()
        self._number = 0
        self._motion: int | None = None
        self._ended: int | None = None  # the state after which the last motion's end was heard
        self._fingers = wire.Fingers(-1, settings.opening, settings.opening, grasped=False)
        self._stamp = 0.0

    def open(self) -> None:
        """Start to open."""
        self._begin(lambda n: wire.move(n, self._settings.opening, self._settings.speed))

    def grasp(self) -> None:
        """Start to close on the strip's edge; does nothing while it is held."""
        self._hear()
        if not self._fingers.grasped:
            s = self._settings
            self._begin(lambda n: wire.grasp(n, s.thinnest, s.thickest, s.speed, s.force))

    def state(self) -> HandState:
        """The newest measured state."""
        self._hear()
        return HandState(
            stamp=self._stamp,
            arrival=self._clock.now(),
            source=SOURCE,
            width=self._fingers.width,
            grasped=self._fingers.grasped and not self._moving,
            moving=self._moving,
        )

    def stop(self) -> None:
        """Hold the fingers where they are; a held object stays held."""
        self._hear()
        if self._motion is not None:
            self._send(lambda n: wire.request(wire.Command.STOP, n))

    @property
    def _moving(self) -> bool:
        """Whether a motion is under way, until a state shows its result: replies come before
        states.
        """
        return self._motion is not None or self._fingers.number == self._ended

    def close(self) -> None:
        """Disconnect; calling it twice is allowed."""
        for link in (self._tcp, self._udp):
            if link is not None:
                link.close()
        self._tcp = self._udp = None

    def _begin(self, made: Callable[[int], bytes]) -> None:
        self.stop()
        self._motion = self._send(made)

    def _send(self, made: Callable[[int], bytes]) -> int:
        tcp, _ = self._links()
        self._number += 1
        try:
            tcp.sendall(made(self._number))
        except OSError as error:
            raise _lost(self._address, error) from error
        return self._number

    def _hear(self) -> None:
        """Read all replies and states that have arrived."""
        self._ready()
        tcp, udp = self._links()
        for _ in range(STALE):
            packet = _packet(udp)
            if packet is None:
                break
            self._take(wire.state(packet))
        self._received += self._stream(tcp)
        for reply in wire.replies(self._received):
            self._end(reply)

    def _take(self, fingers: wire.Fingers | None) -> None:
        """Keep a state that is not the one before, sent once more."""
        if fingers is not None and fingers.number != self._fingers.number:
            self._fingers, self._stamp = fingers, self._clock.now()

    def _end(self, reply: wire.Reply) -> None:
        if reply.number != self._motion:
            return
        self._motion, self._ended = None, self._fingers.number
        if reply.status == wire.Status.FAIL:
            raise Fault("hand_failed", "the hand could not do what it was told; look at Desk")

    def _stream(self, tcp: socket.socket) -> bytes:
        try:
            received = tcp.recv(4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise _lost(self._address, error) from error
        if not received:
            raise _lost(self._address, ConnectionResetError("it closed the connection"))
        return received

    def _links(self) -> tuple[socket.socket, socket.socket]:
        if self._tcp is None or self._udp is None:
            self._ready()
            try:
                self._tcp, self._udp = _connected(self._address)
            except OSError as error:
                raise _lost(self._address, error) from error
            self._stamp = self._clock.now()
        return self._tcp, self._udp


def _connected(address: str) -> tuple[socket.socket, socket.socket]:
    """Connections (TCP and UDP) to the hand at `address`, after its first state."""
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    tcp = socket.create_connection((address, wire.PORT), PATIENCE)
    with suppress(OSError):
        tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    udp.bind((tcp.getsockname()[0], 0))
    tcp.sendall(wire.connect(0, udp.getsockname()[1]))
    received = bytearray()
    while not (answers := wire.replies(received)):
        more = tcp.recv(64)
        if not more:
            raise ConnectionResetError("it closed the connection")
        received += more
    if answers[0].status != wire.Status.SUCCESS:
        raise Fault(
            "hand_version",
            f"the hand at {address} speaks version {answers[0].version} of its interface, "
            f"the cell speaks {wire.VERSION}; update the robot's system image or the cell",
        )
    tcp.setblocking(False)
    udp.setblocking(False)
    return tcp, udp


def _packet(udp: socket.socket) -> bytes | None:
    try:
        return udp.recv(256)
    except BlockingIOError:
        return None


def _lost(address: str, error: OSError) -> Fault:
    return Fault(
        "hand_lost", f"the hand at {address} does not answer ({one_line(error)}); check it in Desk"
    )
