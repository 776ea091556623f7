"""`cell calibrate`: the twin's own calibration, and the wizards."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.calibrate_camera import calibrate_camera
from cell.cli.calibrate_check import calibrate_check
from cell.cli.calibrate_homography import calibrate_homography
from cell.cli.options import Configs

calibrate = typer.Typer(
    help="Calibrate the camera: `camera` its lens, `homography` its place; `check` touches it."
)
calibrate.command(name="camera")(calibrate_camera)
calibrate.command(name="homography")(calibrate_homography)
calibrate.command(name="check")(calibrate_check)


@calibrate.callback(invoke_without_command=True)
def twin(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option(help="Also write the calibration here.")] = None,
    configs: Configs = None,
) -> None:
    """Without a wizard: calibrate the twin's camera anew, for the folds to come."""
    if context.invoked_subcommand is not None:
        return
    from calibration.calibration import save_calibration
    from cell.config.places import find_configs
    from cell.operations.calibrate import calibrate_anew
    from cell.operations.interrupt import Interrupt

    with Interrupt() as interrupted:
        made, path = calibrate_anew(find_configs(configs).cell(), interrupted)
    if out is not None:
        save_calibration(made, out)
    sys.stdout.write(
        f"calibrated: {made.residual_mm:.2f} mm rms at points not used in the fit\n  {path}\n"
    )
