"""Construction of the twin of a cell on one simulated clock."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.installation import Installation
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import Effects, StripModel
from drivers.twin.arm import TwinArm
from drivers.twin.camera import TwinCamera, Visible
from drivers.twin.chain.engine import Chain
from drivers.twin.clock import Rank, TwinClock
from drivers.twin.hand import TwinHand
from drivers.twin.renderer.looks import LOOKS, StripLook
from drivers.twin.scene import Truth
from drivers.twin.settings import TwinSettings
from drivers.twin.world import Plant, World
from drivers.types import Pose

DEFAULT_INSTALLATION = Installation()


def unchanged(world: World) -> Visible:
    """The default view: the camera sees `world` unchanged."""
    return world


@dataclass(frozen=True, slots=True)
class PlantOptions:
    """Parts of a twin that can be replaced: its plant, and the camera's view of its world.

    `engine` makes the plant from a number of links; `view` makes what the camera looks at.
    """

    engine: Callable[[int], Plant] = Chain
    view: Callable[[World], Visible] = unchanged


DEFAULT_PLANT = PlantOptions()


@dataclass(frozen=True, slots=True)
class Desk:
    """Parts of a twin besides arm and hand: clock, world, camera, and `home`, the start pose."""

    clock: TwinClock
    world: World
    camera: TwinCamera
    model: StripModel
    home: Pose

    def truth(self) -> Truth:
        """True history of strip and gripper since the grasp; for scoring only."""
        return self.world.truth()


@dataclass(frozen=True, slots=True)
class Twin(Desk):
    """A cell that is wholly simulated: a desk with arm and hand."""

    arm: TwinArm
    hand: TwinHand


def open_twin(
    settings: TwinSettings,
    plant: StripFile,
    cell_effects: Effects | None,
    seed: int,
    index: int = 0,
    installation: Installation = DEFAULT_INSTALLATION,
    staging: PlantOptions = DEFAULT_PLANT,
) -> Twin:
    """A twin at rest, `plant` flat on its desk, the hand open above the grasped edge.

    The same `seed` gives the same bytes. `index` is the number of runs that this specimen has
    already been through. Raises Unsupported for a plant or an effect that the chain cannot
    simulate.
    """
    desk = open_desk(TwinClock(), settings, plant, cell_effects, seed, index, staging)
    (arm_seed,) = np.random.SeedSequence(seed).spawn(1)
    rng = np.random.default_rng(arm_seed)
    delay = desk.model.rig.delay
    arm = TwinArm(desk.world, desk.clock, settings.arm, installation, rng, delay)
    hand = TwinHand(desk.world, desk.clock, settings.hand)
    return Twin(desk.clock, desk.world, desk.camera, desk.model, desk.home, arm, hand)


def open_desk(
    clock: TwinClock,
    settings: TwinSettings,
    plant: StripFile,
    cell_effects: Effects | None,
    seed: int,
    index: int = 0,
    staging: PlantOptions = DEFAULT_PLANT,
) -> Desk:
    """A desk with strip and camera on `clock`, for an arm that reports its poses to the world."""
    model = describe(plant, cell_effects, index)
    home = Pose(model.stated_length, settings.arm.home_height, 0.0)
    plant_engine = staging.engine(settings.world.links)
    world = World(model, plant_engine, settings.world, home, settings.hand.opening)
    look = LOOKS[settings.look]
    camera = TwinCamera(
        staging.view(world),
        clock,
        settings.camera,
        StripLook.of(plant, look.pattern),
        seed,
        model.observation,
        model.rig.desk_height,
        look,
    )
    clock.every(settings.world.step, world.advance, Rank.WORLD)
    return Desk(clock, world, camera, model, home)
