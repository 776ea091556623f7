"""Accepted effects of the rig, inverted before anybody sees a value: one place for all of them."""

from dataclasses import replace

from calibration.calibration import Calibration
from calibration.correction import corrected
from cell.config.cell import CellFile
from cell.corrected_arm import CorrectedArm
from cell.devices import Devices
from drivers.strip.file import StripFile
from drivers.strip.model import Observation, Rig, StripModel, describe


def corrected_calibration(
    calibration: Calibration, settings: CellFile, strip: StripFile
) -> Calibration:
    """The calibration with what the cell file says of camera and desk taken back."""
    return corrected(calibration, describe(strip, settings.effects))


def corrected_devices(devices: Devices, settings: CellFile, strip: StripFile) -> Devices:
    """The devices with an arm that speaks of true poses; without effects the very same."""
    rig = describe(strip, settings.effects).rig
    if rig == Rig():
        return devices
    return replace(devices, arm=CorrectedArm(devices.arm, devices.hand, rig))


def as_recorded(settings: CellFile, strip: StripFile) -> StripModel:
    """The strip in this cell as its records show it: what is inverted is not in them."""
    model = describe(strip, settings.effects)
    return replace(model, rig=Rig(), observation=Observation())
