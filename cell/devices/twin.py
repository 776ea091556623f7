"""Devices of the twin, its aids for a calibration, and its truth for scoring."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from calibration.wizard.coverage import WantedView
from cell.config.cell import CellFile
from cell.devices.devices import Devices, DeviceSelection
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.twin.board import board_frame, board_pose
from drivers.twin.open import DEFAULT_PLANT, Desk, PlantOptions, Twin, open_twin
from drivers.twin.settings import TwinSettings
from drivers.types import Frame


class TwinCalibrationAids:
    """Calibration aids on the twin: a board before its camera, a pointer in its hand."""

    def __init__(self, twin: Twin | Desk, settings: CellFile, seed: int) -> None:
        self.twin = twin
        self.settings = settings
        self.seed = seed
        self._shown = 0

    def show_board(self, wanted: WantedView) -> Frame:
        """Render an image of the calibration board held as `wanted`."""
        board = self.settings.boards.board()
        placed = board_pose(self.settings.twin.camera, board, wanted)
        self._shown += 1
        return board_frame(
            self.settings.twin.camera, board, placed, self.seed, sequence=self._shown
        )

    def measure_board(self) -> float:
        """Length [m] of all columns of printed squares."""
        return self.settings.boards.width

    def hold_pointer(self, held: bool) -> None:
        """Put the pointer between the twin's fingers, or remove it."""
        self.twin.world.hold_pointer(held)


@dataclass(frozen=True, slots=True)
class TwinPlant:
    """True motion of the strip `plant` on the twin, for the score of a run."""

    twin: Twin | Desk
    plant: StripFile

    def truth(self, origin: float) -> Mapping[str, Any]:
        """Plain values of plant, true touch, displacement and final offset of the edges."""
        truth = self.twin.world.truth()
        touch = truth.touch
        return {
            "plant": self.plant.model_dump(mode="json", by_alias=True),
            "displacement": None if touch is None else touch.displacement,
            "t_layer_touch": None if touch is None else touch.time - origin,
            "l1": None if touch is None else touch.to_grasped,
            "l2": None if touch is None else touch.to_fixed,
            "edge_offset": truth.edge_offset,
        }


def with_twin_camera(devices: Devices, _: CellFile) -> Devices:
    """Return `devices` unchanged, as every simulated arm comes with the twin's camera."""
    return devices


def twin_devices(
    settings: CellFile,
    strip: StripFile,
    choice: DeviceSelection,
    *,
    calibrating: bool,
    staging: PlantOptions = DEFAULT_PLANT,
) -> Devices:
    """Devices of the twin, with the plant on its desk; no rig effects while `calibrating`.

    Without a plant file the twin equals the controller's model of strip and rig.
    """
    plant, lying, rig = plant_on_desk(settings, strip, choice)
    desk, index = settings.twin, choice.index
    if calibrating:
        desk = empty_desk(settings)
        rig = {}
        index = 0
    twin = open_twin(desk, lying, rig, choice.seed, index, settings.installation, staging)
    return Devices(
        clock=twin.clock,
        arm=twin.arm,
        hand=twin.hand,
        camera=twin.camera,
        camera_identity=settings.twin.camera.identity,
        aids=TwinCalibrationAids(twin, settings, choice.seed) if calibrating else None,
        plant=TwinPlant(twin, plant),
    )


def empty_desk(settings: CellFile) -> TwinSettings:
    """Settings of the twin without a strip on its desk, for a calibration."""
    world = settings.twin.world.model_copy(update={"strip": False})
    return settings.twin.model_copy(update={"world": world})


def plant_on_desk(
    settings: CellFile, strip: StripFile, choice: DeviceSelection
) -> tuple[StripFile, StripFile, dict[str, dict[str, float]]]:
    """Plant as recorded, strip that lies on the desk, and effects of the rig."""
    plant = choice.plant
    if plant is None:
        return strip, strip, settings.effects
    of_strip = {n: v for n, v in plant.effects.items() if registry()[n].of == "strip"}
    rig = {n: v for n, v in plant.effects.items() if registry()[n].of == "cell"}
    return plant, plant.model_copy(update={"effects": of_strip}), rig
