"""Parts of the processes that are connected to a robot; the robot stops when they
end.
"""

import gc
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from drivers.base.child import Child, ChildDied
from drivers.base.clock import lock_memory, take_priority, wake_promptly
from drivers.base.installation import Installation
from drivers.franka.failure import ArmFault, Cause, one_line
from drivers.franka.limits import FR3, JointLimits
from drivers.franka.settings import FciSettings, RealTime

END_PATIENCE = 2.0  # s for the arm to come to rest and the process to end
PRIORITY = 80  # of 1 to 99, above ordinary threads and below the kernel's


@dataclass(frozen=True, slots=True)
class RobotAccess:
    """Robot to connect to: its `address`, its settings, the installation of its arm,
    and the joint limits by which its motions are planned.
    """

    address: str
    settings: FciSettings
    installation: Installation
    limits: JointLimits = FR3


class TerminationFlag:
    """Flag that SIGTERM or SIGHUP sets instead of ending this process, so that the arm
    can brake.

    A closed terminal or a shutdown signals every process. One that ended during a
    motion would leave it to the robot to detect the missing commands.
    """

    def __init__(self) -> None:
        self.is_set = False
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._note_signal)

    def check(self) -> None:
        """Raise ArmFault if a signal has asked this process to end; called once the arm
        rests.
        """
        if self.is_set:
            raise ArmFault(Cause.ENDED, "the process of the arm was asked to end")

    def _note_signal(self, *_: object) -> None:
        self.is_set = True


def receive(child: Child, patience: float) -> Any:
    """Next message of a process that is connected to a robot, within `patience` [s].

    Raises ArmFault where the message is one, where none arrives or where the process
    has died.
    """
    try:
        answer = child.receive(patience)
    except ChildDied as died:
        raise ArmFault(Cause.LOST, f"the process of the arm: {died}") from None
    if answer is None:
        raise ArmFault(
            Cause.SILENT, f"the robot did not answer within {patience:.1f} s"
        )
    if isinstance(answer, ArmFault):
        raise answer
    return answer


@contextmanager
def connection(pipe: Connection, access: RobotAccess) -> Iterator[Any]:
    """Context with a connected `drivers.franka.robot.Robot`, for use in the robot's
    process.

    Sends any exception that is raised in it through `pipe`, as an ArmFault.
    """
    gc.disable()  # nothing here makes cycles, and a collection takes longer than a tick
    try:
        from drivers.franka.robot import Robot

        robot = Robot(access.address, access.settings, access.limits)
        apply_realtime(access.settings.scheduling)
        yield robot
    except ArmFault as fault:
        send(pipe, fault)
    except Exception as error:  # noqa: BLE001  an edge: the process ends, and with it the motion
        send(pipe, ArmFault(Cause.LOST, one_line(error)))


def send(pipe: Connection, message: object) -> None:
    """Send a message through `pipe`, unless its other end is gone."""
    with suppress(OSError):
        pipe.send(message)


def apply_realtime(mode: RealTime) -> None:
    """Give this thread the real-time scheduling of `mode`; call it after connecting to
    the robot.

    enforce: memory is locked; the library has taken the priority. priority: memory is
    locked and PRIORITY taken. ignore: only a short time slice is requested. Raises
    ArmFault where the user may not have PRIORITY.
    """
    if mode == "ignore":
        wake_promptly()
        return
    # best effort: an unlocked page may have to be read from disk within a tick
    lock_memory()
    if mode == "priority" and not take_priority(PRIORITY):
        reason = (
            f"this user may not have real-time priority {PRIORITY}, see `ulimit -r`"
        )
        raise ArmFault(Cause.REALTIME, reason)
