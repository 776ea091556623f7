"""Network port of the emulated arm: receives requests of one client, sends replies and states."""

import select

from drivers.fci_server.link import Link, Welcome
from drivers.fci_server.model import robot_model
from drivers.fci_server.publish import Publisher
from drivers.fci_server.reception import Reception
from drivers.fci_server.robot import Robot
from drivers.fci_server.wire import (
    CONNECT_REQUEST,
    CONNECTED,
    PORT,
    PROTOCOL_VERSION,
    Command,
    Malformed,
    MoveRequest,
    MoveStatus,
    Request,
    RobotCommand,
    reply,
    take_request,
)

INCOMPATIBLE = 1
BURST = 256  # datagrams read in one go, so that a flood of them keeps nobody else waiting


class ArmPort:
    """Translates between the wire and the robot; a malformed message ends the connection."""

    def __init__(self, address: str, poll: select.epoll, robot: Robot) -> None:
        self._robot = robot
        self._publisher = Publisher()
        self._reception = Reception(address, PORT, poll, self._parse_greeting)
        self._datagram = b""
        self.version = PROTOCOL_VERSION

    @property
    def client(self) -> Link | None:
        """The connected client, if any."""
        return self._reception.client

    @property
    def datagram_fileno(self) -> int:
        """File descriptor of the client's UDP socket, -1 without a client."""
        return -1 if self.client is None else self.client.datagram_fileno

    def serve(self, descriptor: int) -> None:
        """Handle a readable TCP descriptor, if it belongs to this port."""
        if self._reception.serve(descriptor) and not self._read_requests():
            self.drop(reset=True)

    def drop(self, reset: bool = False) -> None:
        """Disconnect the client; a motion under way ends."""
        self._reception.dismiss(reset)
        self._robot.abandon()

    def close(self) -> None:
        """Disconnect all clients and stop listening."""
        self._reception.close()

    def command(self) -> RobotCommand | None:
        """The client's next well-formed command; None when no more have arrived."""
        for _ in range(BURST):
            datagram = None if self.client is None else self.client.receive_datagram()
            if datagram is None:
                return None
            try:
                return RobotCommand.read(datagram)
            except Malformed:
                continue
        return None

    def publish(self, rate: float, is_nan: bool) -> None:
        """Send the client the state of this tick, then the replies due in this tick.

        `rate` is the fraction of commands that arrived in time; with `is_nan` the measured part of
        the state is NaN, as from a broken sensor.
        """
        robot, client = self._robot, self.client
        if client is None:
            robot.late.clear()
            return
        self._datagram = self._publisher.datagram(robot, rate, is_nan)
        client.send_datagram(self._datagram)
        for late in robot.late:
            client.send(reply(late.command, late.command_id, bytes((late.status,))))
        robot.late.clear()

    def repeat(self) -> None:
        """Send the last state again, for a client that may have missed it."""
        if self.client is not None and self._datagram:
            self.client.send_datagram(self._datagram)

    def _parse_greeting(self, received: bytearray) -> Welcome | None:
        request = take_request(received)
        if request is None:
            return None
        if request.command is not Command.CONNECT:
            raise Malformed(f"{request.command.name} before connecting")
        version, port = CONNECT_REQUEST.unpack(request.payload)
        accepted = version == self.version
        content = CONNECTED.pack(0 if accepted else INCOMPATIBLE, self.version)
        return Welcome(accepted, port, reply(request.command, request.command_id, content))

    def _read_requests(self) -> bool:
        client = self.client
        if client is None or not client.read():
            return False
        try:
            while (request := take_request(client.received)) is not None:
                content = self._answer(request)
                if content and not client.send(reply(request.command, request.command_id, content)):
                    return False
        except Malformed:
            return False
        return True

    def _answer(self, request: Request) -> bytes:
        """Content of the reply to `request`, empty where the reply comes later."""
        robot = self._robot
        if request.command is Command.MOVE:
            status = robot.move(MoveRequest.read(request.payload), request.command_id)
            return bytes((MoveStatus(status),))
        if request.command is Command.STOP_MOVE:
            robot.stop(request.command_id)
            return b""
        if request.command is Command.AUTOMATIC_ERROR_RECOVERY:
            refusal = robot.recover(request.command_id)
            return b"" if refusal is None else bytes((refusal,))
        if request.command is Command.GET_ROBOT_MODEL:
            return b"\0" + robot_model().encode()
        if request.command is Command.CONNECT:
            raise Malformed("connected already")
        return bytes((robot.set(request),))
