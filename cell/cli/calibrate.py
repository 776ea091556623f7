"""`cell calibrate`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Configs


def calibrate(
    out: Annotated[Path | None, typer.Option(help="Also write the calibration here.")] = None,
    configs: Configs = None,
) -> None:
    """Calibrate the twin's camera anew: lens from boards, homography from touched points."""
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
