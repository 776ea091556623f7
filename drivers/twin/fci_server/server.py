"""Server of the emulated robot: one event loop, in lock-step or by the wall clock."""

import select
import socket
import time
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from ipaddress import IPv4Address
from threading import Thread
from typing import Annotated, Self

from pydantic import AfterValidator, Field

from drivers.base.errors import ConfigurationError
from drivers.base.motion import TICK
from drivers.base.settings import Settings
from drivers.base.types import Array
from drivers.franka.collision import Solids
from drivers.franka.limits import Revision
from drivers.franka.model import ArmPlant
from drivers.twin.fci_server.arm_and_hand_ports import ArmPort, HandPort
from drivers.twin.fci_server.dynamics import Dynamics, LaggingArm
from drivers.twin.fci_server.faults import Disturbance, Fault
from drivers.twin.fci_server.hand import Between, EmulatedHand
from drivers.twin.fci_server.robot import EmulatedRobot, Push, resting_robot
from drivers.twin.fci_server.wire import RobotCommand

HAND_PERIOD = 5  # ms, of the hand's states
# s, after which a hand's state goes out while the arm's time is frozen
OFFER_HAND = 0.01
MOST_LATE = 64  # commands for earlier ticks that are skipped in one go
OFFER_ARM = 0.1  # s, after which the arm's last state is offered again
COUNTED_TICKS = 100  # of a motion, over which the share of commands in time is taken
# s at most by which a period is shortened to make up for a late one
LONGEST_CATCH_UP = 0.2 * TICK


def _address(text: str) -> str:
    return str(IPv4Address(text))


class ServerSettings(Settings):
    """Settings of the emulated robot's server: address, clock, lag and mechanics.

    Without an `address` it takes a free one on the loopback, because the clients fix
    the ports. In `lock_step` a motion advances one control period for each command;
    otherwise it runs by the wall clock, where a late command counts as missed. The arm
    has the published limits of `model`, and follows its setpoint with a `delay` [s] and
    a first-order `lag` [s]. Without a `plant` its only torques are those of gravity.
    """

    address: Annotated[str, AfterValidator(_address)] | None = None
    lock_step: bool = True
    model: Revision = "fr3"
    delay: float = Field(0.0, ge=0, le=0.1)
    lag: float = Field(0.0, ge=0, le=0.1)
    plant: ArmPlant | None = None


class PeriodTimer:
    """Timer of control periods of 1 ms by the wall clock, none of them shorter than 0.8
    ms.
    """

    def __init__(self) -> None:
        self._deadline = time.monotonic()

    def remaining(self) -> float:
        """Time [s] until the next control period is due; zero or less once it is
        due.
        """
        return self._deadline - time.monotonic()

    def begin_next(self) -> None:
        """Start the next control period on schedule.

        Of a delay of this machine at most LONGEST_CATCH_UP is caught up; by the rest
        the robot's time falls behind the wall clock, so that the client keeps most of a
        period to answer.
        """
        now = time.monotonic()
        self._deadline = max(self._deadline, now - LONGEST_CATCH_UP) + TICK

    def restart(self) -> None:
        """Start a control period now, however late the last one was."""
        self._deadline = time.monotonic() + TICK


class RobotServer:
    """Server of an emulated robot, whose arm and hand each serve one client at
    `address`.

    `start` (7,) [rad] are the initial joints, `solids` obstacles of the arm, `push` the
    force on its tool, `between` the thickness of the object in the hand, `faults`
    scheduled faults. Listens from its construction on; serves in a thread between
    `start` and `close`, or inside a `with`, or in the caller's by `serve`.
    """

    def __init__(
        self,
        settings: ServerSettings | None = None,
        start: Array | None = None,
        push: Push | None = None,
        between: Between = lambda: None,
        faults: Iterable[Fault] = (),
        solids: Solids | None = None,
    ) -> None:
        settings = settings or ServerSettings()
        self.robot = resting_robot(start, push, solids)
        self.hand = EmulatedHand(between)
        self.robot.revision = settings.model
        _give_mechanics(self.robot, settings)
        self._lock_step = settings.lock_step
        self._poll = select.epoll()

        try:
            self._arm, self._hand_port = self._bind(settings.address)
        except ConfigurationError:
            self._poll.close()
            raise

        self.address = self._arm.address
        self._disturbance = Disturbance(
            script=faults, robot=self.robot, port=self._arm, freeze=self._freeze
        )
        self._waker, self._bell = socket.socketpair()
        self._bell.setblocking(False)
        self._poll.register(self._waker, select.EPOLLIN)
        self._pace = PeriodTimer()
        # s, when a silent client gets a state again
        self._offer_at = time.monotonic() + OFFER_ARM
        self._heard = False  # by the wall clock, whether this tick's command has come
        # by tick, if a command came
        self._in_time: deque[bool] = deque(maxlen=COUNTED_TICKS)
        # in lock-step, from a motion's first command to its end
        self._client_is_clock = False
        self._motion_begin = 0  # robot time [ms] at that command
        self._thread: Thread | None = None
        self._stopping = False

    def start(self) -> Self:
        """Serve clients in a thread of this process."""
        self._thread = Thread(
            target=self.serve, name=f"twin {self.address}", daemon=True
        )
        self._thread.start()
        return self

    def close(self) -> None:
        """Disconnect all clients and free the address; allowed twice."""
        self._stopping = True
        with suppress(OSError):  # it has hung up by itself
            self._bell.send(b"!")
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        else:
            self._disconnect()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def inject(self, fault: Fault) -> None:
        """Schedule one more `fault`, which strikes at once if the number of commands it
        waits for has passed.
        """
        self._disturbance.add(fault)
        self._bell.send(b"!")

    def serve(self) -> None:
        """Serve clients until `close` is called from another thread."""
        try:
            while not self._stopping:
                self._run_once()
        finally:
            self._disconnect()

    def _bind(self, address: str | None) -> tuple[ArmPort, HandPort]:
        """Open the ports of arm and hand at `address`, or, where it is None, at the
        first loopback address where both are free.

        Raises ConfigurationError where they are in use.
        """
        reason = ""
        candidates = [f"127.77.{x}.{y}" for x in range(10) for y in range(1, 251)]
        for candidate in [address] if address else candidates:
            try:
                return self._open(candidate)
            except OSError as error:
                reason = error.strerror or str(error)
        raise ConfigurationError(
            "address: ports 1337 and 1338 cannot be opened at"
            f" {address or '127.77.x.y'}: {reason}; name another address of this"
            " machine"
        )

    def _open(self, address: str) -> tuple[ArmPort, HandPort]:
        """Ports of arm and hand at `address`, opened both or not at all; raises OSError
        where one is in use.
        """
        arm = ArmPort(address, self._poll, self.robot)
        try:
            return arm, HandPort(address, self._poll, self.hand)
        except OSError:
            arm.close()
            raise

    def _disconnect(self) -> None:
        """Close both ports and all sockets of the server; allowed twice."""
        if self._bell.fileno() >= 0:  # else it is closed already
            self._arm.close()
            self._hand_port.close()
            self._bell.close()
            self._waker.close()
            self._poll.close()

    def _run_once(self) -> None:
        """Run one pass of the server's event loop.

        It waits for the next command while the client is the clock, for any request
        while no client is connected and nothing moves, else until the control period
        has passed.
        """
        moving = self._lock_step and self.robot.moving
        self._client_is_clock = self._client_is_clock and moving
        if self._client_is_clock:
            self._wait_for_command()
        elif self._idle():
            self._disturbance.strike()
            self._poll_sockets(None)
            self._pace.restart()
        else:
            self._wait_for_period()

    def _idle(self) -> bool:
        """Whether no client is connected and nothing moves."""
        alone = self._arm.client is None and self._hand_port.client is None
        return alone and self.robot.posture.at_rest and not self.hand.moving

    def _wait_for_command(self) -> None:
        """In lock-step, wait for the client's command and execute it."""
        arm = self._arm
        events = self._poll_sockets(OFFER_HAND)
        if not events:
            self._hand_port.repeat()
            if time.monotonic() >= self._offer_at:
                arm.repeat()
                self._offer_at = time.monotonic() + OFFER_ARM

        command = arm.command()
        if command is None:
            return

        if arm.datagram_fileno not in events:
            # requests that were sent before this command, and after the wait
            self._poll_sockets(0)

        if command.message_id == self.robot.time and self.robot.moving:
            self._follow(command)
            self._offer_at = time.monotonic() + OFFER_ARM
            self._pace.restart()

    def _wait_for_period(self) -> None:
        """By the wall clock, wait for a command or for the end of the control
        period.
        """
        robot = self.robot
        self._poll_sockets(max(self._pace.remaining(), 0.0))
        command = self._next_command()
        if command is not None and self._lock_step:
            # The client has begun: from here on its commands are the clock.
            self._client_is_clock = True
            self._motion_begin = robot.time
            if command.message_id == robot.time:
                self._follow(command)
            return

        if command is not None and not self._heard:
            self._heard = True
            self._in_time.append(robot.receive(command))
        if self._pace.remaining() <= 0:
            self._pass_period()
            self._pace.begin_next()

    def _next_command(self) -> RobotCommand | None:
        """Next command of the client for this tick of a motion; late ones are skipped
        except in lock-step, and None means that none has arrived.
        """
        for _ in range(MOST_LATE):
            command = self._arm.command()
            if command is None:
                break
            current = command.message_id == self.robot.time or self._lock_step
            if current and self.robot.moving:
                return command
        return None

    def _pass_period(self) -> None:
        """End a control period, with or without a command, and advance robot time."""
        robot = self.robot
        heard = self._heard
        self._heard = False
        if not heard and (self._lock_step or not robot.moving):
            robot.rest()
        elif not heard:
            self._in_time.append(False)
            robot.miss()
        self._advance()

    def _follow(self, command: RobotCommand) -> None:
        """Execute `command` and advance robot time by the tick that it is for."""
        self._in_time.append(self.robot.receive(command))
        self._advance()

    def _advance(self) -> None:
        """Advance robot time by 1 ms: apply faults, step arm and hand, send states."""
        in_time = self._in_time
        robot = self.robot
        self._disturbance.strike()
        robot.advance()
        self.hand.advance()
        ended = self._hand_port.answer()
        if ended or (robot.time - self._motion_begin) % HAND_PERIOD == 0:
            self._hand_port.publish(robot.time)
        if robot.motion is None:
            in_time.clear()

        self._arm.publish(sum(in_time) / max(len(in_time), 1))

    def _freeze(self, duration: float) -> None:
        """Neither send nor answer for `duration` [s]; `close` and `inject` cut it
        short.
        """
        pause = select.poll()
        pause.register(self._waker, select.POLLIN)
        pause.poll(1000 * duration)
        self._pace.restart()

    def _poll_sockets(self, seconds: float | None) -> set[int]:
        """Wait for data at the sockets, `seconds` at most unless None, and serve those
        of TCP; returns all readable file descriptors.

        The hand is served before the arm, so that a command for it counts from the same
        tick.
        """
        if seconds is not None and 0 < seconds < OFFER_HAND:
            select.select([self._poll], [], [], seconds)  # epoll counts in milliseconds
            seconds = 0

        events = {descriptor for descriptor, _ in self._poll.poll(seconds)}
        requests = events - {self._arm.datagram_fileno}
        for descriptor in requests:
            self._hand_port.serve(descriptor)

        for descriptor in requests:
            self._arm.serve(descriptor)
            if descriptor == self._waker.fileno() and not self._stopping:
                self._waker.recv(64)

        if requests:
            self._hand_port.discard()

        return events


def _give_mechanics(robot: EmulatedRobot, settings: ServerSettings) -> None:
    """Give `robot` the delay, lag and joint torques that `settings` state."""
    delay = settings.delay
    sag = None  # of an elastic joint
    plant = settings.plant
    if plant is not None:
        robot.dynamics = Dynamics(plant)
        delay += plant.delay
        if any(plant.compliance):
            sag = robot.dynamics.sag

    if delay or settings.lag or sag is not None:
        tool = robot.configuration.tool
        robot.trailing = LaggingArm(robot.posture, tool, delay, settings.lag, sag)
