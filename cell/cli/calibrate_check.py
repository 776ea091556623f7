"""`cell calibrate check`."""

import json
import math
import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.fold import ArmDriver, CameraDriver
from cell.cli.options import Configs, Json
from cell.cli.wizard_options import Interactive, tell_verdict


def calibrate_check(
    file: Annotated[
        Path | None,
        typer.Argument(help="calibration.yaml [default: the one that folds use]."),
    ] = None,
    arm: Annotated[ArmDriver | None, typer.Option(help="Arm driver.")] = None,
    camera: Annotated[CameraDriver | None, typer.Option(help="Camera driver.")] = None,
    interactive: Interactive = False,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Touch a few points again: does the calibration still hold?"""
    from rich.console import Console

    from calibration.calibration import load_calibration
    from calibration.wizard.words import check_lines
    from cell.cli.calibrate_homography import opened
    from cell.config.places import find_configs
    from cell.operations.calibrate import calibration_of
    from cell.operations.calibration_check import check_calibration
    from cell.operations.interrupt import Interrupt
    from cell.operations.keyboard import operator_of
    from cell.operations.wizard_panel import WizardPanel

    settings = find_configs(configs).cell()
    panel = WizardPanel(Console(stderr=True))
    with Interrupt() as interrupted, panel:
        calibration = (
            calibration_of(settings, panel.ask) if file is None else load_calibration(file)
        )
        devices = opened(settings, arm, camera)
        operator = operator_of(devices, panel.ask, interactive=interactive)
        verdict = check_calibration(settings, devices, calibration, operator, panel, interrupted)
    if as_json:
        line = {
            "calibration": calibration.id,
            "passed": verdict.passed,
            "errors_mm": {str(number): error for number, error in verdict.errors_mm.items()},
            "median_mm": verdict.median_mm if math.isfinite(verdict.median_mm) else None,
            "worst_mm": verdict.worst_mm if math.isfinite(verdict.worst_mm) else None,
            "reasons": list(verdict.reasons),
        }
        sys.stdout.write(json.dumps(line) + "\n")
    else:
        tell_verdict(check_lines(verdict))
    sys.exit(0 if verdict.passed else 1)
