"""Network ports of the emulated robot's arm and hand: requests in, replies and states
out.
"""

import select

from drivers.franka import hand_protocol
from drivers.franka.hand_protocol import HandCommand
from drivers.franka.model import arm_urdf
from drivers.twin.fci_server.connection import Port
from drivers.twin.fci_server.hand import EmulatedHand
from drivers.twin.fci_server.robot import EmulatedRobot
from drivers.twin.fci_server.state import Publisher
from drivers.twin.fci_server.wire import (
    ARM_FRAMING,
    HAND_FRAMING,
    PORT,
    PROTOCOL_VERSION,
    ClientRequest,
    Command,
    Malformed,
    MoveRequest,
    RobotCommand,
)

BURST = 256  # datagrams read per cycle, so that a flood does not delay other clients


class ArmPort(Port[Command]):
    """Network port of the emulated arm: answers requests, reads commands, sends
    states.
    """

    def __init__(self, address: str, poll: select.epoll, robot: EmulatedRobot) -> None:
        self._robot = robot
        self._publisher = Publisher()
        super().__init__(address, PORT, poll, ARM_FRAMING, PROTOCOL_VERSION)

    @property
    def datagram_fileno(self) -> int:
        """File descriptor of the client's UDP socket, -1 without a client."""
        return -1 if self.client is None else self.client.datagram_fileno

    def command(self) -> RobotCommand | None:
        """Next well-formed command of the client; None where none has arrived."""
        for _ in range(BURST):
            datagram = None if self.client is None else self.client.receive_datagram()
            if datagram is None:
                return None
            try:
                return RobotCommand.read(datagram)
            except Malformed:
                continue
        return None

    def publish(self, rate: float) -> None:
        """Send the client the robot's state of this tick of 1 ms, then the replies that
        are due in it.

        `rate` is the fraction of commands that arrived in time.
        """
        robot = self._robot
        if self.client is not None:
            self._datagram = self._publisher.datagram(robot, rate)
            self.client.send_datagram(self._datagram)
            for late in robot.late:
                content = bytes((late.status,))
                self.client.send(
                    ARM_FRAMING.reply(late.command, late.command_id, content)
                )
        robot.late.clear()

    def _abandon(self) -> None:
        self._robot.abandon()

    def _answer(self, request: ClientRequest[Command]) -> bytes:
        """Content of the reply to `request`; empty for a reply that is due only
        later.
        """
        command_id = request.command_id
        robot = self._robot
        match request.command:
            case Command.MOVE:
                motion = MoveRequest.read(request)
                return bytes((robot.move(motion, command_id),))
            case Command.STOP_MOVE:
                robot.stop(command_id)
                return b""
            case Command.AUTOMATIC_ERROR_RECOVERY:
                refusal = robot.recover(command_id)
                return b"" if refusal is None else bytes((refusal,))
            case Command.GET_ROBOT_MODEL:
                return b"\0" + arm_urdf(robot.revision).encode()
            case _:
                return bytes((robot.set(request),))


class HandPort(Port[HandCommand]):
    """Network port of the emulated hand: answers requests and sends states."""

    def __init__(self, address: str, poll: select.epoll, hand: EmulatedHand) -> None:
        self._hand = hand
        version = hand_protocol.PROTOCOL_VERSION
        super().__init__(address, hand_protocol.PORT, poll, HAND_FRAMING, version)

    def discard(self) -> None:
        """Read and ignore a UDP datagram of the client: the hand takes none."""
        if self.client is not None:
            self.client.receive_datagram()

    def answer(self) -> bool:
        """Send the client the hand's replies that are due; returns whether there were
        any.
        """
        replies = self._hand.replies
        ended = bool(replies)
        for content in replies:
            if self.client is not None:
                self.client.send(content)
        replies.clear()
        return ended

    def publish(self, time: int) -> None:
        """Send the client the hand's state at robot `time` [ms]."""
        self._datagram = self._hand.state(time)
        self.repeat()

    def repeat(self) -> None:
        """Send the hand's last state again, as a client waits for one even if time
        stands still.
        """
        if self.client is not None:
            self.client.send_datagram(self._datagram or self._hand.state(0))

    def _abandon(self) -> None:
        self._hand.interrupt()
        self._hand.replies.clear()

    def _answer(self, request: ClientRequest[HandCommand]) -> bytes:
        self._hand.begin(request)
        self.answer()
        return b""
