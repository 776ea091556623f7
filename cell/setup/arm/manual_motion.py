"""Manual motions of the arm (home, park, jog, open), supervised by the same monitors as
a fold.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from cell.base.config.cell import CellFile
from cell.base.devices.devices import Trial
from cell.base.devices.open import NO_STRIP, check_drivers, open_cell
from cell.orchestrator.context import ManualInputs, ManualLog
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.phases import MANUAL_PHASES
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.run import ControlLoop
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.steps import Motion, move
from drivers.base.errors import ConfigurationError
from drivers.base.types import Pose
from drivers.franka.checks import joint_limits
from drivers.strip.file import StripFile

if TYPE_CHECKING:
    from drivers.franka.process import RobotAccess


def move_manually(
    settings: CellFile,
    trial: Trial,
    motion: Callable[[Snapshot], Motion],
    interrupted: Callable[[], bool] = lambda: False,
    strip: StripFile = NO_STRIP,
) -> Outcome:
    """Open the devices of the cell, carry out one `motion` of the arm, close them, and
    return the outcome; CellError for errors before the motion.
    """
    devices = open_cell(settings, strip, trial, calibrating=False)
    try:
        devices.connect()
        run = ControlLoop(
            devices=devices,
            inputs=ManualInputs(settings.controller, motion),
            log=ManualLog(),
            phases=MANUAL_PHASES,
            recorder=Recorder(),
            interrupted=interrupted,
        )
        return run.execute()
    finally:
        devices.close()


def jog(x: float, z: float, pitch: float) -> Callable[[Snapshot], Motion]:
    """Motion of the gripper from its present pose by `x` and `z` [m] and by the angle
    `pitch` [rad].
    """

    def motion(snapshot: Snapshot) -> Motion:
        here = snapshot.arm.commanded
        return (yield from move(Pose(here.x + x, here.z + z, here.pitch + pitch)))

    return motion


def to_home(settings: CellFile, strip: StripFile) -> Callable[[Snapshot], Motion]:
    """Motion that brings the gripper to rest at its home, which lies above the free
    edge of `strip`.
    """
    return lambda _: move(Pose(strip.length, settings.installation.home_height, 0.0))


def home_joints(settings: CellFile, strip: StripFile) -> tuple[float, ...]:
    """Seven joint angles [rad] of a Franka arm at its home, chosen so that its joints
    stay far from their limits in a fold of `strip`.
    """
    check_drivers(settings.with_drivers("fci"))
    from cell.base.devices.fci import start_joints

    installation = settings.fci.limit(settings.installation)
    limits = joint_limits(settings.fci)
    return start_joints(installation, settings.fold, strip.length, limits)


def robot_task(settings: CellFile) -> "RobotAccess":
    """Connection to the robot of the cell; ConfigurationError where the cell file
    states no address of a robot.
    """
    fci = settings.fci
    check_drivers(settings.with_drivers("fci"))
    if fci.address is None:
        raise ConfigurationError(
            "fci.address: is missing; name the robot's address in cell.yaml, or that of"
            " a twin that `cell twin serve` has started"
        )
    from drivers.franka.process import RobotAccess

    limits = joint_limits(fci)
    address = fci.address
    return RobotAccess(
        address=address, settings=fci, installation=settings.installation, limits=limits
    )
