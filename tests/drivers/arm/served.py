"""A served robot, and what the cell's process is given to drive it, over loopback."""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.arm.process import Task
from drivers.arm.settings import CollisionSettings, FciSettings, HandLimits
from drivers.fci_server.server import RobotServer
from drivers.types import frozen
from tests.drivers.arm.test_loop import INSTALLATION, JOINTS

COLLISION = CollisionSettings(
    torque_lower=21.0,
    torque_upper=31.0,
    force_lower=22.0,
    force_upper=32.0,
    moment_lower=13.0,
    moment_upper=23.0,
)


@contextmanager
def served(**given) -> Iterator[RobotServer]:
    """A robot at rest over the strip's edge, its hand homed and open."""
    with RobotServer(start=frozen(JOINTS), **given) as server:
        server.hand.width = HandLimits().opening
        yield server


def task(server: RobotServer, **changes) -> Task:
    """The robot as the cell drives it in lock-step."""
    usual = {"realtime": "ignore", "collision": COLLISION}
    return Task(server.address, FciSettings(**(usual | changes)), INSTALLATION, None)


def near(shift: float = 0.05) -> list[float]:
    """Joints (7,) [rad] a little beside where a served robot stands."""
    return [JOINTS[0] + shift, *JOINTS[1:]]
