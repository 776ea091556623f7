"""The command `cell doctor`: checks machine, files, robot and camera."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Configs, Json, Runs, while_busy


def doctor(
    runs: Runs = Path("runs"),
    configs: Configs = None,
    seconds: Annotated[
        float, typer.Option(min=1, max=3600, help="How long the network to the robot is tested.")
    ] = 60.0,
    as_json: Json = False,
) -> None:
    """Check machine, files, robot and camera; says what was found, why it matters, what to do."""
    from cell.config.places import find_configs
    from cell.devices.devices import DeviceSelection
    from cell.doctor.check import State
    from cell.doctor.doctor import checks
    from drivers.errors import PreflightRefused

    red = False
    found = checks(find_configs(configs), DeviceSelection(), runs, seconds)
    for number, check in enumerate(while_busy("checking", found), start=1):
        red = red or check.state is State.FAIL
        line = json.dumps(check.line(number)) if as_json else check.text(number)
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
    if red:
        sys.exit(PreflightRefused.exit_code)
