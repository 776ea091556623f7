"""One client at one port: its TCP connection and its UDP socket."""

import socket
import struct
from dataclasses import dataclass
from typing import Protocol

RESET = struct.pack("ii", 1, 0)
MOST_PENDING = 64 * 1024  # bytes of requests that nobody has read yet


class Link:
    """A client's TCP and UDP sockets; no call blocks, or raises when the client is gone."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._datagrams: socket.socket | None = None
        self.received = bytearray()

    def fileno(self) -> int:
        """File descriptor of the TCP connection."""
        return self._connection.fileno()

    @property
    def datagram_fileno(self) -> int:
        """File descriptor of the UDP socket, -1 before it is opened."""
        return -1 if self._datagrams is None else self._datagrams.fileno()

    def read(self) -> bool:
        """Append the bytes that have arrived to `received`; False when the client is gone."""
        try:
            content = self._connection.recv(4096)
        except BlockingIOError:
            return True
        except OSError:
            return False
        self.received += content
        return bool(content) and len(self.received) <= MOST_PENDING

    def send(self, content: bytes) -> bool:
        """Send whole replies; False when the client is gone or reads nothing."""
        try:
            return self._connection.send(content) == len(content)
        except OSError:
            return False

    def open_datagrams(self, address: str, port: int) -> bool:
        """Open UDP between `address` and the client's `port`; False for an invalid port."""
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        datagrams.setblocking(False)
        try:
            datagrams.bind((address, 0))
            datagrams.connect((self._connection.getpeername()[0], port))
        except OSError:
            datagrams.close()
            return False
        self._datagrams = datagrams
        return True

    def send_datagram(self, content: bytes) -> None:
        """Send one datagram, which may be lost."""
        if self._datagrams is not None:
            try:
                self._datagrams.send(content)
            except OSError:
                return

    def receive_datagram(self) -> bytes | None:
        """The next datagram of the client; None when there is none."""
        if self._datagrams is None:
            return None
        try:
            return self._datagrams.recv(2048)
        except OSError:
            return None

    def close(self, reset: bool = False) -> None:
        """Disconnect; with `reset` at once by RST, so that the client waits for no answer."""
        if reset:
            self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        self._connection.close()
        if self._datagrams is not None:
            self._datagrams.close()


@dataclass(frozen=True, slots=True)
class Welcome:
    """Answer to a client's connection request: granted or not, its UDP port, the reply."""

    accepted: bool
    port: int
    reply: bytes


class Greeting(Protocol):
    """Parser of a client's first bytes."""

    def __call__(self, received: bytearray) -> Welcome | None:
        """Parse a connection request; None while incomplete, Malformed for any other message."""
