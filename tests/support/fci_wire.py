"""Client of the arm's protocol that packs bytes by the published numbers of the
protocol.

It shares no code with the server: offsets, sizes and numbers stand here as they are
described.
"""

import socket
import struct
from dataclasses import dataclass, field

MOVE, STOP_MOVE, SET_COLLISION, RECOVERY, MODEL = 1, 2, 3, 10, 11
STARTED, PREEMPTED, REFLEX_ABORTED, EMERGENCY_ABORTED = 1, 2, 8, 9
IDLE, MOVING, REFLEX, USER_STOPPED = 1, 2, 4, 5
JOINT_VELOCITY, CARTESIAN_POSE, CARTESIAN_VELOCITY = 1, 2, 3
SILENCE = 3.0  # s, after which a test no longer waits for the server


@dataclass(frozen=True)
class State:
    """State of the robot as received in a datagram."""

    raw: bytes

    @property
    def message_id(self) -> int:
        return struct.unpack_from("<Q", self.raw, 0)[0]

    def floats(self, offset: int, count: int) -> tuple[float, ...]:
        return struct.unpack_from(f"<{count}f", self.raw, offset)

    @property
    def place(self) -> tuple[float, ...]:
        """Translation of O_T_EE [m], the last column of a column-major matrix."""
        return self.floats(8 + 12 * 4, 3)

    @property
    def q(self) -> tuple[float, ...]:
        return self.floats(596, 7)

    @property
    def dq(self) -> tuple[float, ...]:
        return self.floats(596 + 2 * 28, 7)

    @property
    def pose_c(self) -> tuple[float, ...]:
        return self.floats(976, 16)

    @property
    def errors(self) -> list[int]:
        return [index for index, flag in enumerate(self.raw[1290:1331]) if flag]

    @property
    def reasons(self) -> list[int]:
        return [index for index, flag in enumerate(self.raw[1331:1372]) if flag]

    @property
    def generator(self) -> int:
        return self.raw[1288]

    @property
    def mode(self) -> int:
        return self.raw[1372]


def robot_command(
    message_id: int,
    q=(0.0,) * 7,
    dq=(0.0,) * 7,
    pose=(0.0,) * 16,
    twist=(0.0,) * 6,
    finished: bool = False,
) -> bytes:
    """371 bytes: id, joints, pose, twist, elbow, two flags, torques, a flag."""
    numbers = struct.pack("<38d", *q, *dq, *pose, *twist, 0.0, 0.0)
    tail = struct.pack("<BB7dB", 0, finished, *[0.0] * 7, 0)
    return struct.pack("<Q", message_id) + numbers + tail


def move_request(generator: int, controller: int = 0) -> bytes:
    """113 bytes: controller, generator, two deviations, async flag, largest
    velocities.
    """
    return struct.pack(
        "<II6dB7d", controller, generator, *[10.0, 3.12, 6.28] * 2, 0, *[0.0] * 7
    )


@dataclass
class RawArm:
    """Client with one TCP connection and one UDP socket to the robot."""

    PORT, HEADER, CONNECTED = 1337, "<III", "<BH"

    address: str
    version: int = 10
    tcp: socket.socket = field(init=False)
    udp: socket.socket = field(init=False)
    connected: tuple[int, int] = field(init=False)
    _ids: int = 0

    def __post_init__(self) -> None:
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.settimeout(SILENCE)
        self.server: tuple[str, int] | None = None
        self.tcp = socket.create_connection((self.address, self.PORT), SILENCE)
        port = self.udp.getsockname()[1]
        self.request(0, struct.pack("<HH", self.version, port))
        try:
            self.connected = struct.unpack(self.CONNECTED, self.reply()[2])
        except ConnectionResetError:
            self.close()
            raise

    def __enter__(self) -> "RawArm":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.tcp.close()
        self.udp.close()

    def request(self, number: int, payload: bytes = b"") -> int:
        """Send a request; returns its identifier."""
        self._ids += 1
        size = struct.calcsize(self.HEADER) + len(payload)
        self.tcp.sendall(struct.pack(self.HEADER, number, self._ids, size) + payload)
        return self._ids

    def reply(self) -> tuple[int, int, bytes]:
        """Command, identifier and content of the next reply."""
        begin = struct.calcsize(self.HEADER)
        number, command_id, size = struct.unpack(self.HEADER, self._exactly(begin))
        return number, command_id, self._exactly(size - begin)

    def ask(self, number: int, payload: bytes = b"") -> int:
        """Status in the reply to a request."""
        asked = self.request(number, payload)
        answered, command_id, content = self.reply()
        assert (answered, command_id) == (number, asked)
        return content[0]

    def state(self) -> State:
        raw, self.server = self.udp.recvfrom(4096)
        return State(raw)

    def newest(self) -> State:
        """Newest state that has arrived, or else the next one."""
        return self.newest_after(self.state())

    def until(self, holds) -> State:
        """First state that satisfies `holds`."""
        for _ in range(3000):
            state = self.state()
            if holds(state):
                return state
        raise AssertionError("no such state")

    def send(self, datagram: bytes) -> None:
        assert self.server is not None
        self.udp.sendto(datagram, self.server)

    def begin(self, generator: int) -> State:
        """Start a motion; returns the first state that reports it."""
        assert self.ask(MOVE, move_request(generator)) == STARTED
        return self.until(lambda state: state.mode == MOVING)

    def start_still(self, generator: int = CARTESIAN_VELOCITY) -> State:
        """Start a motion at rest; returns the first state whose ticks follow commands.

        Commands for states that the server has sent on from are passed over.
        """
        self.begin(generator)
        state = self.newest()
        for _ in range(5):
            state = self.newest_after(self.tick(state, pose=state.pose_c, q=state.q))
        return state

    def newest_after(self, state: State) -> State:
        """The newest state that has arrived, at least as new as `state`."""
        self.udp.setblocking(False)
        try:
            while True:
                state = State(self.udp.recv(4096))
        except BlockingIOError:
            return state
        finally:
            self.udp.settimeout(SILENCE)

    def tick(self, state: State, **command) -> State:
        """Answer `state` with a command; returns the following state."""
        self.send(robot_command(state.message_id, **command))
        return self.until(lambda after: after.message_id > state.message_id)

    def _exactly(self, count: int) -> bytes:
        content = b""
        while len(content) < count:
            part = self.tcp.recv(count - len(content))
            if not part:
                raise ConnectionResetError("the server hung up")
            content += part
        return content
