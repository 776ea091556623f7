"""`cell calibrate homography`."""

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.cli.fold import ArmDriver, CameraDriver
from cell.cli.options import Configs, Json
from cell.cli.wizard_options import (
    SESSIONS,
    From,
    Interactive,
    Out,
    Viz,
    Without,
    WizardViz,
    session_folder,
    tell_verdict,
    watching,
)

if TYPE_CHECKING:
    from calibration.calibration import Calibration
    from calibration.lens import Lens
    from calibration.wizard.latency import LatencyVerdict
    from calibration.wizard.touch_verdict import TouchVerdict
    from cell.config.cell import CellFile
    from cell.devices.devices import Devices
    from cell.operations.homography_wizard import TouchSession


def calibrate_homography(
    lens: Annotated[
        Path | None,
        typer.Option(help="Lens file of ROS or OpenCV [default: the newest in calibrations/]."),
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(help="Touch the poses of this file, an edited poses.yaml.")
    ] = None,
    accept_anyway: Annotated[
        bool,
        typer.Option("--accept-anyway", help="Take a refused calibration; every run then says so."),
    ] = False,
    arm: Annotated[ArmDriver | None, typer.Option(help="Arm driver.")] = None,
    camera: Annotated[CameraDriver | None, typer.Option(help="Camera driver.")] = None,
    out: Out = None,
    again: From = None,
    without: Without = None,
    interactive: Interactive = False,
    viz: Viz = WizardViz.SAVE,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Find the map to the plane and the latency from touches of the gripper's tip."""
    from cell.config.places import find_configs

    settings = find_configs(configs).cell()
    if again is not None:
        from cell.operations.solve_again import homography_again

        solved, made = homography_again(
            again, without or (), out, settings.fold.speed, accept_anyway=accept_anyway
        )
        _finish(settings, solved.touches, solved.latency, made, out, as_json=as_json)
    else:
        folder = session_folder(out, settings.name, "homography")
        devices = opened(settings, arm, camera)
        session = _run(
            settings,
            devices,
            _lens(lens, devices),
            folder,
            viz,
            poses,
            interactive=interactive,
            accept_anyway=accept_anyway,
        )
        made = session.calibration
        _finish(settings, session.touches, session.latency, made, folder, as_json=as_json)
    sys.exit(0 if made is not None else 1)


def opened(settings: "CellFile", arm: ArmDriver | None, camera: CameraDriver | None) -> "Devices":
    """The cell's devices for a calibration, without a strip."""
    from cell.devices.devices import DeviceSelection
    from cell.devices.open import open_cell
    from cell.operations.calibrate import NO_STRIP

    choice = DeviceSelection(arm and arm.value, camera and camera.value)
    return open_cell(settings, NO_STRIP, choice, calibrating=True)


def _lens(path: Path | None, devices: "Devices") -> "Lens":
    from calibration.camera_info import read_lens
    from cell.operations.lens_wizard import newest_lens

    return read_lens(path or newest_lens(SESSIONS, devices.camera_identity))


def _run(
    settings: "CellFile",
    devices: "Devices",
    lens: "Lens",
    folder: Path,
    viz: WizardViz,
    poses: Path | None,
    *,
    interactive: bool,
    accept_anyway: bool,
) -> "TouchSession":
    from rich.console import Console

    from cell.operations.homography_wizard import calibrate_homography as touch
    from cell.operations.homography_wizard import read_poses
    from cell.operations.interrupt import Interrupt
    from cell.operations.keyboard import operator_of
    from cell.operations.wizard_panel import WizardPanel

    panel = WizardPanel(Console(stderr=True))
    operator = operator_of(devices, panel.ask, interactive=interactive)
    plan = None if poses is None else read_poses(poses)
    with Interrupt() as interrupted, watching(panel, folder, viz) as watch:
        return touch(
            settings,
            devices,
            lens,
            folder,
            operator,
            watch,
            plan=plan,
            accept_anyway=accept_anyway,
            interrupted=interrupted,
        )


def _finish(
    settings: "CellFile",
    touches: "TouchVerdict | None",
    latency: "LatencyVerdict | None",
    made: "Calibration | None",
    folder: Path | None,
    *,
    as_json: bool,
) -> None:
    if as_json:
        sys.stdout.write(json.dumps(_line(touches, latency, made, folder)) + "\n")
    else:
        _tell(settings, touches, latency, made, folder)


def _tell(
    settings: "CellFile",
    touches: "TouchVerdict | None",
    latency: "LatencyVerdict | None",
    made: "Calibration | None",
    folder: Path | None,
) -> None:
    from calibration.wizard.words import touch_lines

    tell_verdict(touch_lines(touches, latency, settings.fold.speed))
    if made is None:
        sys.stdout.write("not accepted; --accept-anyway takes it, and every run will say so\n")
    elif folder is None:
        sys.stdout.write("name a folder with --out to keep it\n")
    else:
        if made.accepted_anyway:
            sys.stdout.write("accepted in spite of this; every run will say so\n")
        path = (folder / "calibration.yaml").resolve()
        sys.stdout.write(f"to use it, in cell.yaml\n  calibration: {path}\n")


def _line(
    touches: "TouchVerdict | None",
    latency: "LatencyVerdict | None",
    made: "Calibration | None",
    folder: Path | None,
) -> dict[str, Any]:
    from calibration.wizard.words import refusals

    return {
        "accepted": made is not None,
        "calibration": None if made is None else made.id,
        "residual_mm": None if touches is None else _number(touches.residual_mm),
        "worst_mm": None if touches is None else _number(touches.worst_mm),
        "halves_mm": None if touches is None else _number(touches.halves_mm),
        "displacement_mm": None if touches is None else _number(touches.displacement_mm),
        "latency": None if latency is None else _number(latency.latency),
        "reasons": list(refusals(touches, latency)),
        "folder": None if folder is None else str(folder),
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
