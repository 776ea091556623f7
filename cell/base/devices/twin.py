"""Devices of the simulated cell (twin), its aids for calibration, and the strip's true
state for scoring.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from calibration.wizard.coverage import WantedView
from cell.base.config.cell import CellFile
from cell.base.devices.devices import Devices, Trial
from drivers.base.types import Frame
from drivers.strip.file import StripFile
from drivers.twin.board import board_frame, board_pose
from drivers.twin.open import DEFAULT_PLANT, Desk, PlantOptions, Twin, open_twin
from drivers.twin.settings import TwinSettings


class TwinCalibrationAids:
    """Calibration aids of the twin: a board held before its camera, and a pointer
    between its fingers.
    """

    def __init__(self, twin: Twin | Desk, settings: CellFile, seed: int) -> None:
        self.twin = twin
        self.settings = settings
        self.seed = seed
        self._shown = 0

    def show_board(self, wanted: WantedView) -> Frame:
        """Render an image of the calibration board, held so that it appears in the
        image as `wanted` states.
        """
        camera = self.settings.twin.camera
        board = self.settings.boards.board()
        self._shown += 1
        pose = board_pose(camera, board, wanted)
        return board_frame(camera, board, pose, self.seed, sequence=self._shown)

    def hold_pointer(self, held: bool) -> None:
        """Put the pointer between the twin's fingers if `held` is true,
        else remove it.
        """
        self.twin.world.hold_pointer(held)


@dataclass(frozen=True, slots=True)
class TwinPlant:
    """True state of the strip `plant` on the twin, by which a run is scored."""

    twin: Twin | Desk
    plant: StripFile

    def truth(self, origin: float, goal: float = 0.0) -> Mapping[str, Any]:
        """True time [s] since `origin` and lengths [m] of the layers' touch, edge
        offset [m] and strip, by name; None for what did not happen.
        """
        world = self.twin.world
        touch = world.touch
        plant = {"plant": self.plant.model_dump(mode="json", by_alias=True)}
        if touch is None:
            names = ("displacement", "t_layer_touch", "l1", "l2", "edge_offset")
            return plant | dict.fromkeys(names)
        return plant | {
            "displacement": replace(touch, goal=goal).displacement,
            "t_layer_touch": touch.time - origin,
            "l1": touch.to_grasped,
            "l2": touch.to_fixed,
            "edge_offset": None if world.holds_strip else world.edge_offset + goal,
        }


def simulated(
    settings: CellFile, strip: StripFile, trial: Trial, *, calibrating: bool
) -> tuple[TwinSettings, StripFile]:
    """Settings of the twin, and the strip on its desk: that of `trial`, or else `strip`
    with the cell's own effects.

    The plant has the effects of strip and rig. While `calibrating` the desk is bare.
    """
    twin = settings.twin
    plant = trial.plant or strip
    if calibrating:
        bare = twin.world.model_copy(update={"strip": False})
        return twin.model_copy(update={"world": bare}), plant.model_copy(
            update={"effects": {}}
        )
    effects = plant.effects if trial.plant else {**strip.effects, **settings.effects}
    return twin, plant.model_copy(update={"effects": effects})


def twin_devices(
    settings: CellFile,
    strip: StripFile,
    trial: Trial,
    *,
    calibrating: bool,
    staging: PlantOptions = DEFAULT_PLANT,
) -> Devices:
    """Devices of the simulated cell with the strip on its desk; errors of the rig are
    left out while `calibrating`.

    Without a plant file the twin equals the controller's model of strip and rig.
    """
    index = 0 if calibrating else trial.index
    simulation, plant = simulated(settings, strip, trial, calibrating=calibrating)
    twin = open_twin(
        settings=simulation,
        plant=plant,
        seed=trial.seed,
        index=index,
        installation=settings.installation,
        staging=staging,
    )
    return Devices(
        clock=twin.clock,
        arm=twin.arm,
        hand=twin.hand,
        camera=twin.camera,
        camera_identity=settings.twin.camera.identity,
        aids=TwinCalibrationAids(twin, settings, trial.seed) if calibrating else None,
        plant=TwinPlant(twin, trial.plant or strip),
    )
