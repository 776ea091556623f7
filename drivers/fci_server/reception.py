"""One port of the robot, which accepts one client and refuses others."""

import select
import socket

from drivers.fci_server.link import Greeting, Link
from drivers.fci_server.wire import Malformed

MOST_GUESTS = 8  # connections that have not yet said who they are


class Reception:
    """A listening port, its pending connections and its one client.

    A connection without a request stays pending: it blocks nothing, and the oldest is dropped when
    there are too many. A second client is refused by a reset, so that its library does not wait for
    a reply.
    """

    def __init__(self, address: str, port: int, poll: select.epoll, greeting: Greeting) -> None:
        self._poll, self._greeting, self._address = poll, greeting, address
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.setblocking(False)
        try:
            self._listener.bind((address, port))
            self._listener.listen(16)
        except OSError:
            self._listener.close()
            raise
        self._guests: dict[int, Link] = {}
        self.client: Link | None = None
        poll.register(self._listener, select.EPOLLIN)

    def serve(self, descriptor: int) -> bool:
        """Handle a readable descriptor; False unless it is the client's own connection."""
        if descriptor == self._listener.fileno():
            while self._accept():
                continue
        elif descriptor in self._guests:
            self._read_greeting(self._guests[descriptor])
        return self.client is not None and descriptor == self.client.fileno()

    def dismiss(self, reset: bool = False) -> None:
        """Disconnect the client."""
        if self.client is not None:
            self._poll.unregister(self.client.fileno())
            self._poll.unregister(self.client.datagram_fileno)
            self.client.close(reset)
            self.client = None

    def close(self) -> None:
        """Disconnect all clients and stop listening."""
        self.dismiss()
        for guest in list(self._guests.values()):
            self._refuse(guest)
        self._poll.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> bool:
        """Let in the next connection that waits as a guest; False where none waits."""
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return False
        if len(self._guests) >= MOST_GUESTS:
            self._refuse(next(iter(self._guests.values())))
        guest = Link(connection)
        self._guests[guest.fileno()] = guest
        self._poll.register(guest.fileno(), select.EPOLLIN)
        return True

    def _read_greeting(self, guest: Link) -> None:
        """Read a guest's connection request and admit it as the client, or refuse it."""
        if not guest.read():
            self._refuse(guest)
            return
        try:
            welcome = self._greeting(guest.received)
        except Malformed:
            self._refuse(guest)
            return
        if welcome is None:
            return
        if not welcome.accepted:
            guest.send(welcome.reply)
            self._refuse(guest, reset=False)
        elif self.client is not None or not guest.open_datagrams(self._address, welcome.port):
            self._refuse(guest)
        else:
            del self._guests[guest.fileno()]
            self.client = guest
            self._poll.register(guest.datagram_fileno, select.EPOLLIN)
            if not guest.send(welcome.reply):
                self.dismiss()

    def _refuse(self, guest: Link, reset: bool = True) -> None:
        self._poll.unregister(guest.fileno())
        del self._guests[guest.fileno()]
        guest.close(reset)
