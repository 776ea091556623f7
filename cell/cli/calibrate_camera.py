"""`cell calibrate camera`."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.cli.fold import CameraDriver
from cell.cli.options import Configs, Json
from cell.cli.wizard_options import (
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
    from calibration.wizard.lens_verdict import LensVerdict
    from cell.config.cell import CellFile


def calibrate_camera(
    print_to: Annotated[
        Path | None, typer.Option("--print", help="Only write the board as a PDF of true size.")
    ] = None,
    measured: Annotated[
        float | None,
        typer.Option(help="Length of all columns of squares by a ruler [mm].", min=1.0),
    ] = None,
    camera: Annotated[CameraDriver | None, typer.Option(help="Camera driver.")] = None,
    out: Out = None,
    again: From = None,
    without: Without = None,
    interactive: Interactive = False,
    viz: Viz = WizardViz.SAVE,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Find the lens from views of a ChArUco board; says which view is wanted next, and why."""
    from cell.config.places import find_configs

    settings = find_configs(configs).cell()
    if print_to is not None:
        _print(settings, print_to)
        return
    if again is not None:
        from cell.operations.solve_again import lens_again

        verdict, folder = lens_again(again, without or (), out), out or again
    else:
        folder = session_folder(out, settings.name, "camera")
        verdict = _run(settings, camera, folder, measured, viz, interactive=interactive)
    _tell(verdict, folder, as_json=as_json)
    sys.exit(0 if verdict.passed else 1)


def _run(
    settings: "CellFile",
    camera: CameraDriver | None,
    folder: Path,
    measured: float | None,
    viz: WizardViz,
    *,
    interactive: bool,
) -> "LensVerdict":
    from rich.console import Console

    from cell.devices.devices import DeviceSelection
    from cell.devices.open import open_cell
    from cell.operations.calibrate import NO_STRIP
    from cell.operations.interrupt import Interrupt
    from cell.operations.keyboard import operator_of
    from cell.operations.lens_wizard import calibrate_lens
    from cell.operations.wizard_panel import WizardPanel

    choice = DeviceSelection(arm="twin", camera=camera and camera.value)  # no arm is needed
    devices = open_cell(settings, NO_STRIP, choice, calibrating=True)
    panel = WizardPanel(Console(stderr=True))
    operator = operator_of(devices, panel.ask, interactive=interactive)
    if measured is None and devices.aids is None:
        words = f"length of {settings.boards.columns} squares by a ruler [mm]"
        measured = typer.prompt(words, type=float)
    length = None if measured is None else measured / 1e3
    with Interrupt() as interrupted, watching(panel, folder, viz) as watch:
        session = calibrate_lens(settings, devices, folder, operator, watch, length, interrupted)
    return session.verdict


def _print(settings: "CellFile", path: Path) -> None:
    from calibration.wizard.board_print import print_board

    sheet = print_board(settings.boards, path)
    sys.stdout.write(
        f"{path}: print it on {sheet} at 100 %, glue it on something flat; all "
        f"{settings.boards.columns} squares must measure {1e3 * settings.boards.width:.1f} mm\n"
    )


def _tell(verdict: "LensVerdict", folder: Path, *, as_json: bool) -> None:
    from calibration.wizard.words import lens_lines

    if not as_json:
        tell_verdict(lens_lines(verdict))
        sys.stdout.write(f"  {folder}\n")
        return
    line = {
        "passed": verdict.passed,
        "views": verdict.views,
        "rms_px": None if verdict.fit is None else verdict.fit.rms,
        "halves_mm": None if verdict.fit is None else verdict.bend_mm,
        "reasons": list(verdict.reasons),
        "folder": str(folder),
    }
    sys.stdout.write(json.dumps(line) + "\n")
