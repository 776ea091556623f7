"""Network port of the emulated robot for one client, and that client's connection."""

import select
import socket
import struct
from abc import ABC, abstractmethod
from typing import Generic

from drivers.twin.fci_server.wire import ClientRequest, Framing, K, Malformed

RESET = struct.pack("ii", 1, 0)
MOST_PENDING = 64 * 1024  # bytes of unread requests
MOST_GUESTS = 8  # connections that have not identified themselves
INCOMPATIBLE = 1


class Connection:
    """TCP and UDP sockets of one client of the emulated robot; no method blocks, or
    raises once the client has gone.
    """

    def __init__(self, tcp: socket.socket) -> None:
        tcp.setblocking(False)
        tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._tcp = tcp
        self._udp: socket.socket | None = None
        self.received = bytearray()

    def fileno(self) -> int:
        """File descriptor of the client's TCP connection."""
        return self._tcp.fileno()

    @property
    def datagram_fileno(self) -> int:
        """File descriptor of the client's UDP socket, -1 before it is opened."""
        return -1 if self._udp is None else self._udp.fileno()

    def read(self) -> bool:
        """Append the client's bytes that have arrived over TCP to the buffer
        `received`; returns False once the client has gone.
        """
        try:
            content = self._tcp.recv(4096)
        except BlockingIOError:
            return True
        except OSError:
            return False
        self.received += content
        return bool(content) and len(self.received) <= MOST_PENDING

    def send(self, content: bytes) -> bool:
        """Send `content` to the client over TCP; returns False unless all of it is
        taken at once.
        """
        try:
            return self._tcp.send(content) == len(content)
        except OSError:
            return False

    def open_datagrams(self, address: str, port: int) -> bool:
        """Open a UDP socket between `address` and the client's `port`; returns False
        where the port is invalid.
        """
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        udp.setblocking(False)
        try:
            udp.bind((address, 0))
            udp.connect((self._tcp.getpeername()[0], port))
        except OSError:
            udp.close()
            return False
        self._udp = udp
        return True

    def send_datagram(self, content: bytes) -> None:
        """Send the client one UDP datagram, which may be lost."""
        if self._udp is not None:
            try:
                self._udp.send(content)
            except OSError:
                return

    def receive_datagram(self) -> bytes | None:
        """Next UDP datagram of the client; None where none has arrived."""
        if self._udp is None:
            return None
        try:
            return self._udp.recv(2048)
        except OSError:
            return None

    def reset_on_close(self) -> None:
        """Let `close` reset the TCP connection, so that the client does not wait for a
        reply.
        """
        self._tcp.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)

    def close(self) -> None:
        """Close both sockets of the client."""
        self._tcp.close()
        if self._udp is not None:
            self._udp.close()


class Port(ABC, Generic[K]):
    """Listening TCP port of the emulated robot, with one client at most, and with
    connections that are yet to be admitted.

    A connection without a request stays pending: it blocks nothing, and the oldest is
    dropped when there are too many. A second client is refused by a reset, so that its
    library does not wait for a reply. A malformed message ends the connection.
    """

    def __init__(
        self,
        address: str,
        port: int,
        poll: select.epoll,
        framing: Framing[K],
        version: int,
    ) -> None:
        """Listen for clients at `address`, for requests in `framing`, of protocol
        `version`.
        """
        self._poll = poll
        self._framing = framing
        self.address = address
        self.version = version
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.setblocking(False)

        try:
            self._listener.bind((address, port))
            self._listener.listen(16)
        except OSError:
            self._listener.close()
            raise

        self._guests: dict[int, Connection] = {}
        self.client: Connection | None = None
        self._datagram = b""
        poll.register(self._listener, select.EPOLLIN)

    @abstractmethod
    def _answer(self, request: ClientRequest[K]) -> bytes:
        """Bytes of the reply to the client's `request`; empty where the reply is sent
        later.
        """

    @abstractmethod
    def _abandon(self) -> None:
        """End the motion or the hand's command of a client that has disconnected."""

    def serve(self, descriptor: int) -> None:
        """Accept the connections or read the bytes that wait at the TCP socket
        `descriptor`, if it belongs to this port.
        """
        if descriptor == self._listener.fileno():
            while self._accept():
                continue
        elif descriptor in self._guests:
            self._greet(self._guests[descriptor])
        client = self.client
        if client is None or descriptor != client.fileno():
            return
        if not self._serve(client):
            client.reset_on_close()
            self.drop()

    def drop(self) -> None:
        """Disconnect the client, and end its motion or the hand's command."""
        self._dismiss()
        self._abandon()

    def repeat(self) -> None:
        """Send the client the datagram of the newest state again, as it may have been
        lost.
        """
        if self.client is not None and self._datagram:
            self.client.send_datagram(self._datagram)

    def close(self) -> None:
        """Disconnect all clients of the port and stop listening."""
        self._dismiss()
        for guest in list(self._guests.values()):
            self._refuse(guest)
        self._poll.unregister(self._listener)
        self._listener.close()

    def _serve(self, client: Connection) -> bool:
        """Answer the client's requests that have arrived; False if it must be
        disconnected.
        """
        if not client.read():
            return False
        try:
            while (request := self._framing.take(client.received)) is not None:
                if request.command == 0:
                    raise Malformed("connected already")
                content = self._answer(request)
                reply = self._framing.reply(
                    request.command, request.command_id, content
                )
                if content and not client.send(reply):
                    return False
        except Malformed:
            return False
        return True

    def _dismiss(self) -> None:
        if self.client is not None:
            self._poll.unregister(self.client.fileno())
            self._poll.unregister(self.client.datagram_fileno)
            self.client.close()
            self.client = None

    def _accept(self) -> bool:
        """Accept one waiting connection, which is admitted only at its request; returns
        False where none waits.
        """
        guests = self._guests
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return False

        if len(guests) >= MOST_GUESTS:
            self._refuse(next(iter(guests.values())))

        guest = Connection(connection)
        guests[guest.fileno()] = guest
        self._poll.register(guest.fileno(), select.EPOLLIN)
        return True

    def _greet(self, guest: Connection) -> None:
        """Read the request of `guest`, a connection not yet admitted, and admit or
        refuse it.
        """
        try:
            present = guest.read()
            request = self._framing.take(guest.received) if present else None
        except Malformed:
            self._refuse(guest)
            return
        if not present or (request is not None and request.command != 0):
            self._refuse(guest)
        elif request is not None:
            self._admit(guest, request)

    def _admit(self, guest: Connection, request: ClientRequest[K]) -> None:
        """Make the connection `guest` the client, whose UDP port in `request` gets the
        robot's states, or refuse it.
        """
        version, port = request.values
        status = 0 if version == self.version else INCOMPATIBLE
        content = self._framing.status.pack(status) + struct.pack("<H", self.version)
        reply = self._framing.reply(request.command, request.command_id, content)
        if version != self.version:
            guest.send(reply)
            self._dismiss_guest(guest)
        elif self.client is not None or not guest.open_datagrams(self.address, port):
            self._refuse(guest)
        else:
            del self._guests[guest.fileno()]
            self.client = guest
            self._poll.register(guest.datagram_fileno, select.EPOLLIN)
            if not guest.send(reply):
                self._dismiss()

    def _refuse(self, guest: Connection) -> None:
        guest.reset_on_close()
        self._dismiss_guest(guest)

    def _dismiss_guest(self, guest: Connection) -> None:
        self._poll.unregister(guest.fileno())
        del self._guests[guest.fileno()]
        guest.close()
