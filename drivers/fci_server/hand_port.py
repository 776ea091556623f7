"""Network port of the emulated hand: receives requests of one client, sends replies, states."""

import select

from drivers.fci_server.hand import TEMPERATURE, WIDEST, Hand
from drivers.fci_server.hand_wire import CONNECTED, reply, take_request
from drivers.fci_server.link import Link, Welcome
from drivers.fci_server.reception import Reception
from drivers.fci_server.wire import Malformed
from drivers.franka.hand_protocol import PORT, PROTOCOL_VERSION, STATE_PACKET, HandCommand


class HandPort:
    """Translates between the wire and the hand; a malformed message ends the connection."""

    def __init__(self, address: str, poll: select.epoll, hand: Hand) -> None:
        self._hand = hand
        self._reception = Reception(address, PORT, poll, _parse_greeting)
        self._datagram = b""

    @property
    def client(self) -> Link | None:
        """The connected client, if any."""
        return self._reception.client

    def serve(self, descriptor: int) -> None:
        """Handle a readable TCP descriptor, if it belongs to this port."""
        if self._reception.serve(descriptor) and not self._read_requests():
            self._hand.interrupt()
            self._hand.replies.clear()
            self._reception.dismiss(reset=True)

    def close(self) -> None:
        """Disconnect all clients and stop listening."""
        self._reception.close()

    def discard(self) -> None:
        """Read and ignore a datagram of the client: the hand takes none."""
        if self.client is not None:
            self.client.receive_datagram()

    def answer(self) -> bool:
        """Send the replies that are due; returns whether there were any."""
        ended = bool(self._hand.replies)
        for content in self._hand.replies:
            if self.client is not None:
                self.client.send(content)
        self._hand.replies.clear()
        return ended

    def publish(self, time: int) -> None:
        """Send the client the hand's state at robot `time` [ms]."""
        self._datagram = _state(self._hand, time)
        self.repeat()

    def repeat(self) -> None:
        """Send the last state again, to a client that waits for one while time stands still."""
        if self.client is not None:
            self.client.send_datagram(self._datagram or _state(self._hand, 0))

    def _read_requests(self) -> bool:
        client = self.client
        if client is None or not client.read():
            return False
        try:
            while (request := take_request(client.received)) is not None:
                if request.command is HandCommand.CONNECT:
                    return False
                self._hand.begin(request)
        except Malformed:
            return False
        self.answer()
        return True


def _state(hand: Hand, time: int) -> bytes:
    width, widest = (hand.width, WIDEST) if hand.is_homed else (0.0, 0.0)
    return STATE_PACKET.pack(time & 0xFFFFFFFF, width, widest, hand.is_grasped, TEMPERATURE)


def _parse_greeting(received: bytearray) -> Welcome | None:
    request = take_request(received)
    if request is None:
        return None
    if request.command is not HandCommand.CONNECT:
        raise Malformed(f"{request.command.name} before connecting")
    version, port = request.values
    accepted = version == PROTOCOL_VERSION
    content = CONNECTED.pack(0 if accepted else 1, PROTOCOL_VERSION)
    return Welcome(accepted, int(port), reply(request.command, request.command_id, content))
