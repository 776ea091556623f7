"""Devices of a cell with a Franka arm, real or emulated, whose poses the simulated
strip follows.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from cell.base.config.cell import CellFile
from cell.base.config.settings import FoldSettings
from cell.base.devices.devices import Devices, Trial
from cell.base.devices.fold_path import triangle, whole_path
from cell.base.devices.real_camera import open_camera
from cell.base.devices.twin import TwinCalibrationAids, TwinPlant, simulated
from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError
from drivers.base.installation import Installation
from drivers.base.protocols import Camera
from drivers.base.types import frozen
from drivers.franka.arm import FciArm
from drivers.franka.checks import joint_limits
from drivers.franka.hand import FciHand
from drivers.franka.limits import FR3, JointLimits
from drivers.franka.obstacles import floor_of
from drivers.franka.process import RobotAccess
from drivers.franka.reach import plan_reach
from drivers.strip.file import StripFile
from drivers.twin.camera import PacedCamera
from drivers.twin.clock import RealTimeClock, TwinClock
from drivers.twin.fci_server.server import RobotServer, ServerSettings
from drivers.twin.open import (
    Desk,
    follow_arm,
    open_desk,
    thickness_between_fingers,
    weight_on_gripper,
)

CellClock = TwinClock | RealTimeClock | WallClock
CATCHING_UP = 0.02  # s per tick for strip and camera to catch up with a robot's time


def fci_devices(
    settings: CellFile, strip: StripFile, trial: Trial, *, calibrating: bool = False
) -> Devices:
    """Devices of a cell whose arm is the Franka robot at the configured address, or
    without one a robot emulated in this process.

    The emulated one runs in lock-step; an arm at an address runs on its own time, and
    strip and camera keep up with it. While `calibrating` the desk is bare, and the twin
    provides the calibration aids. Where the camera is real, too, nothing is simulated
    beside a robot on its own time. Raises ConfigurationError for an effect of the rig
    that this arm cannot simulate.
    """
    address = settings.fci.address
    lock_step = settings.fci.in_lock_step
    gripping = settings if calibrating else _expect_thickness(settings, strip)
    if settings.camera_driver.real and address is not None and not lock_step:
        alone = WallClock()
        camera = open_camera(settings, alone)
        return replace(
            _robot_devices(
                alone, *fci_arm(gripping, alone, address), camera, camera.identity
            ),
            camera_locks=lambda: camera.locks,
        )

    world = TwinClock()
    clock = world if lock_step else RealTimeClock(world, CATCHING_UP)
    simulation, plant = simulated(settings, strip, trial, calibrating=calibrating)
    installation = settings.installation
    desk = open_desk(
        clock=world,
        settings=simulation,
        plant=plant,
        seed=trial.seed,
        index=trial.index,
        installation=installation,
    )
    if desk.model.rig.delay != 0:
        raise ConfigurationError(
            "effects: control_delay cannot be simulated with arm fci; use arm twin"
        )

    servers = [] if address is not None else [_start_robot(settings, strip, desk)]
    arm, hand = fci_arm(gripping, clock, address or servers[0].address)
    follow_arm(desk, simulation, arm.catch_up, hand)
    twins = desk.camera if lock_step else PacedCamera(desk.camera)
    return replace(
        _robot_devices(
            clock,
            arm,
            hand,
            camera=twins,
            identity=settings.twin.camera.identity,
            servers=servers,
        ),
        aids=TwinCalibrationAids(desk, settings, trial.seed) if calibrating else None,
        plant=TwinPlant(desk, trial.plant or strip),
    )


def _robot_devices(
    clock: CellClock,
    arm: FciArm,
    hand: FciHand,
    camera: Camera,
    identity: str,
    servers: Sequence[RobotServer] = (),
) -> Devices:
    """Devices of a cell with the robot's `arm` and `hand` and a `camera`; `servers`
    that emulate the robot are closed with them.
    """
    return Devices(
        clock=clock,
        arm=arm,
        hand=hand,
        camera=camera,
        camera_identity=identity,
        aids=None,
        plant=None,
        others=(*servers, hand),
        arm_timing=lambda: arm.timing,
        arm_joints=lambda: arm.joints,
        real_time=not isinstance(clock, TwinClock),
    )


def fci_arm(
    settings: CellFile, clock: CellClock, address: str
) -> tuple[FciArm, FciHand]:
    """Drivers of the arm and hand of the robot at `address`, which keep the time of
    `clock`.
    """
    stated = settings.fci
    installation = stated.limit(settings.installation)
    limits = joint_limits(stated)

    def origin() -> float | None:
        return None if isinstance(clock, TwinClock) else clock.origin

    access = RobotAccess(
        address=address, settings=stated, installation=installation, limits=limits
    )
    arm = FciArm(access, clock, origin)
    hand = FciHand(address, stated.hand, clock, ready=arm.join)
    return arm, hand


@lru_cache(maxsize=16)
def start_joints(
    installation: Installation,
    fold: FoldSettings,
    length: float,
    limits: JointLimits = FR3,
) -> tuple[float, ...]:
    """Start joints (7,) [rad] of a Franka arm that leave the most margin in a plain
    fold of a strip of `length` [m]; ConfigurationError without any.
    """
    path, speeds = whole_path(length, installation, fold, triangle(length))
    reach = plan_reach(installation, path, speeds, limits=limits)
    if not reach.allowed:
        raise ConfigurationError(
            f"installation.mounting: the arm cannot follow a fold: {reach.problems[0]};"
            " move robot or strip, see `cell fold --dry-run --arm fci`"
        )
    joints: list[float] = reach.start.tolist()
    return tuple(joints)


def _start_robot(settings: CellFile, strip: StripFile, desk: Desk) -> RobotServer:
    """Start an emulated robot in a thread, whose hand can grasp the strip on the
    simulated `desk`.
    """
    stated = settings.fci
    installation = stated.limit(settings.installation)
    frame = installation.mounting.transform()
    limits = joint_limits(stated)
    start = start_joints(installation, settings.fold, strip.length, limits)
    twin = settings.twin.arm
    mechanics = ServerSettings(
        model=stated.model,
        delay=twin.robot_delay,
        lag=twin.robot_lag,
        plant=twin.robot_plant,
    )
    server = RobotServer(
        mechanics,
        start=frozen(start),
        push=lambda *_: weight_on_gripper(desk, frame),
        between=lambda: thickness_between_fingers(desk, settings.twin.hand),
        solids=floor_of(installation),
    )
    server.hand.width = stated.hand.opening
    tool = stated.tool  # as set in Desk
    server.robot.configuration = replace(
        server.robot.configuration, hand_mass=tool.mass, hand_centre=frozen(tool.centre)
    )
    return server.start()


def _expect_thickness(settings: CellFile, strip: StripFile) -> CellFile:
    """Copy of the cell's settings, in which the hand counts an object as thick as
    `strip` as grasped.
    """
    low, high = strip.spread.get("thickness", (strip.thickness, strip.thickness))
    hand = settings.fci.hand.for_thickness(low, high)
    return settings.model_copy(
        update={"fci": settings.fci.model_copy(update={"hand": hand})}
    )
