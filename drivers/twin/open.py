"""Construction of the simulated cell, either complete, or as a desk with a strip for an
arm outside of it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from drivers.base.geometry import CellInRobot
from drivers.base.installation import Installation
from drivers.base.protocols import Hand
from drivers.base.types import Array, Pose
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.twin.arm_and_hand import TwinArm, TwinHand
from drivers.twin.camera import ScenesOverTime, TwinCamera, displaced_optics
from drivers.twin.chain.engine import Chain
from drivers.twin.clock import Rank, TwinClock
from drivers.twin.renderer.looks import LOOKS, StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import HandSettings, TwinSettings
from drivers.twin.world import Fingers, Plant, World

DEFAULT_INSTALLATION = Installation()
PERIOD = 0.005  # s between two poses that are read from an external arm

MeasuredPose = Callable[[], tuple[float, Pose] | None]


@dataclass(frozen=True, slots=True)
class PlantOptions:
    """Parts of the simulated cell that can be replaced: the strip's engine, and the
    camera's view.

    `engine` makes the plant for a number of links; `view` makes what the camera sees of
    a world.
    """

    engine: Callable[[int], Plant] = Chain
    view: Callable[[World], ScenesOverTime] = attrgetter("scene")


DEFAULT_PLANT = PlantOptions()


@dataclass(frozen=True, slots=True)
class Desk:
    """Simulated desk with a strip and a camera but without arm and hand; the gripper
    starts at the pose `home`.
    """

    clock: TwinClock
    world: World
    camera: TwinCamera
    model: StripModel
    home: Pose


@dataclass(frozen=True, slots=True)
class Twin(Desk):
    """Simulated cell: a desk with arm and hand."""

    arm: TwinArm
    hand: TwinHand


def open_twin(
    settings: TwinSettings,
    plant: StripFile,
    seed: int,
    index: int = 0,
    installation: Installation = DEFAULT_INSTALLATION,
    staging: PlantOptions = DEFAULT_PLANT,
) -> Twin:
    """Create the simulated cell at rest: the strip of `plant` lies on the desk, and the
    open hand is above the edge to grasp.

    The `plant` may also have effects of the rig. The same `seed` gives the same bytes.
    `index` is the number of runs that this specimen has already been through.
    """
    desk = open_desk(
        clock=TwinClock(),
        settings=settings,
        plant=plant,
        seed=seed,
        index=index,
        installation=installation,
        staging=staging,
    )
    (arm_seed,) = np.random.SeedSequence(seed).spawn(1)
    rng = np.random.default_rng(arm_seed)
    arm = TwinArm(
        world=desk.world,
        clock=desk.clock,
        settings=settings.arm,
        installation=installation,
        rng=rng,
    )
    hand = TwinHand(desk.world, desk.clock, settings.hand)
    return Twin(desk.clock, desk.world, desk.camera, desk.model, desk.home, arm, hand)


def open_desk(
    clock: TwinClock,
    settings: TwinSettings,
    plant: StripFile,
    seed: int,
    index: int,
    installation: Installation,
    staging: PlantOptions = DEFAULT_PLANT,
) -> Desk:
    """Create a simulated desk with strip and camera on `clock`; an arm outside of it
    moves its gripper.
    """
    model = describe(plant, index=index)
    home = Pose(model.stated_length, installation.home_height, 0.0)
    plant_engine = staging.engine(settings.world.links)
    world = World(
        model=model,
        plant=plant_engine,
        settings=settings.world,
        start=home,
        opening=settings.hand.opening,
    )
    look = LOOKS[settings.look]
    fabric = StripLook.from_file(plant, look.pattern)
    observation = model.observation
    optics = displaced_optics(settings.camera, observation, model.rig.desk_height)
    renderer = Renderer(
        settings=settings.camera,
        look=fabric,
        seed=seed,
        optics=optics,
        contact_bias=observation.contact_bias,
        surround=look,
    )
    latency = observation.camera_latency
    camera = TwinCamera(
        view=staging.view(world),
        clock=clock,
        settings=settings.camera,
        renderer=renderer,
        seed=seed,
        latency=latency,
    )
    clock.every(settings.world.step, world.advance, Rank.WORLD)
    return Desk(clock=clock, world=world, camera=camera, model=model, home=home)


def thickness_between_fingers(desk: Desk, settings: HandSettings) -> float | None:
    """Thickness [m] of the strip that a hand outside of the simulated `desk` would
    close on; None where no strip is between its fingers.
    """
    if desk.world.holds_strip or desk.world.edge_within(settings.reach, settings.lean):
        return desk.model.mechanics.thickness
    return None


def weight_on_gripper(desk: Desk, frame: CellInRobot) -> Array:
    """Weight (3,) [N] of the lifted strip on the gripper, along the axes of the robot's
    base.
    """
    return frame.matrix[:3, :3] @ (0.0, 0.0, -desk.world.load)


def follow_arm(
    desk: Desk, settings: TwinSettings, measured: MeasuredPose, hand: Hand
) -> None:
    """Let an arm and a `hand` that are not parts of the twin move the gripper over
    `desk`.

    `measured` gives the arm's newest stamp [s] and pose, None while it is not
    connected. A pose is waited for until an image shows it; then the gripper counts as
    resting at the last one.
    """
    world = desk.world
    patience = settings.camera.transport_delay - settings.earliest_image
    last = desk.home

    def follow(time: float) -> None:
        nonlocal last
        newest = measured()
        stamp, pose = newest or (time, last)
        world.add_pose(max(stamp, time - patience), lambda: pose)
        if newest is None:
            return

        last = pose
        fingers = hand.state()
        world.move_fingers(Fingers(fingers.width, fingers.width, start=time, speed=1.0))
        if fingers.grasped and not world.holds_strip:
            if thickness_between_fingers(desk, settings.hand) is not None:
                world.attach()
        elif not fingers.grasped and world.holds_strip:
            world.detach()

    desk.clock.every(PERIOD, follow, Rank.SERVO)
