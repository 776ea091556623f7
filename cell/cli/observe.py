"""The command `cell observe`: measures the strip on a film of a fold and writes a run."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Configs, Json, Strip, busy, check_names, print_json
from drivers.errors import ConfigurationError


def observe(
    film: Annotated[
        Path, typer.Argument(metavar="FILM", help="Film of a fold by a camera that stands still.")
    ],
    strip: Strip,
    calibration: Annotated[
        Path | None,
        typer.Option(help="Calibration of that camera at that place, from `cell calibrate`."),
    ] = None,
    board: Annotated[
        bool, typer.Option("--board", help="The film begins with the printed board instead.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="New run folder [default: runs/NAME of the film].")
    ] = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Read a film into a run folder: profile, contact, tip, confidence, and an overlay to look at.

    The film begins with the strip lying flat and still. No arm need be in the picture.
    """
    check_names(configs, strip)
    if board == (calibration is not None):
        raise ConfigurationError("observe: give either --board or --calibration FILE")
    from cell.folding.observe import observe as read
    from cell.record.files import OVERLAY

    folder = out or Path("runs") / film.stem
    with busy("reading the film") as say:
        found = read(
            film, calibration, strip, folder, configs,
            lambda time: say(f"reading the film: {time:.1f} s"),
        )  # fmt: skip
    d = None if found.touch is None else found.touch.displacement
    if as_json:
        line = {"run": folder, "images": found.images, "read": found.read}
        print_json({**line, "displacement": None if d is None else round(d, 6)})
        return
    text = "no touch of the layers was seen" if d is None else f"displacement {1e3 * d:+.1f} mm"
    sys.stdout.write(f"{film}: {found.read} of {found.images} images read; {text}\n")
    sys.stdout.write(f"  {folder}\n  {folder / OVERLAY}\n")
