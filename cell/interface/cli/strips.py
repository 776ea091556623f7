"""Commands `cell strips`: list strips, measure one, make the file of a new one."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.base.config.places import find_configs
from cell.interface.cli.options import (
    Configs,
    Json,
    length_option,
    strip_names,
    taking,
    writable,
)
from cell.interface.cli.output import notice, print_json, print_table, say
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from drivers.strip.file import StripFile

NAME_PATTERN = re.compile(r"(?!unknown$)[A-Za-z0-9][A-Za-z0-9_-]*")

strips = typer.Typer(
    help="List the strips that this cell knows; measure one, make a new one.",
    invoke_without_command=True,
    rich_markup_mode=None,
)


@strips.callback()
def list_strips(
    context: typer.Context, configs: Configs = None, as_json: Json = False
) -> None:
    """List the strips that this cell knows; further commands measure one or make a new
    one.
    """
    if context.invoked_subcommand is not None:
        return

    configurations = find_configs(configs)
    all_strips: list[StripFile] = []
    for name in configurations.strip_names():
        try:
            all_strips.append(configurations.strip(name))
        except ConfigurationError as error:  # the others are listed all the same
            notice(str(error))

    if as_json:
        print_json(
            *(strip.model_dump(mode="json", by_alias=True) for strip in all_strips)
        )
        return

    columns = ("strip", "length mm", "width mm", "g/m²", "bending mm", "retardation ms")
    keys = ("length", "width", "areal_density", "bending_length", "retardation_time")
    rows = [
        (s.name, *(f"{1e3 * getattr(s, key):.4g}" for key in keys)) for s in all_strips
    ]
    print_table(columns, rows, f"Strips in {configurations.folder / 'strips'}")


@strips.command()
def measure(
    strip: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="Strip, by name.", autocompletion=strip_names
        ),
    ],
    photo: Annotated[
        list[Path] | None,
        typer.Option(help="Photograph of the strip hanging over a ledge; repeatable."),
    ] = None,
    overhang: Annotated[
        list[float] | None,
        length_option(
            "--overhang", "Its length from ledge to tip [m]; one for each --photo."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for pictures and numbers [default: measured/NAME]."),
    ] = None,
    write: Annotated[
        bool,
        typer.Option("--write", help="Put the bending length into the strip's file."),
    ] = False,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Measure a strip's bending length on photographs of it hanging over a ledge."""
    from datetime import UTC, datetime

    from cell.setup.strips.edit import MEASUREMENT_FILE, put_into, save
    from cell.setup.strips.measurement import measure as measure_strip
    from cell.setup.strips.photograph import read_photographs
    from drivers.base.outputs import check_output_folder
    from drivers.strip.describe import load_strip

    _check_name(strip)
    strip_file = None
    if write:
        strip_file = writable(configs).strip_path(strip)
        load_strip(strip_file)
    folder = out or Path("measured") / strip
    check_output_folder(folder, MEASUREMENT_FILE)
    measurement = measure_strip(strip, read_photographs(photo or [], overhang or []))
    save(measurement, folder)
    where = "add --write to put it into the strip's file"
    if strip_file is not None:
        put_into(strip_file, measurement, datetime.now(UTC).date())
        where = f"written to {strip_file}"
    text = f"{measurement.text()}\n  pictures: {folder}\n  {where}"
    facts = {**measurement.line(), "out": folder, "written": strip_file}
    say(facts, text, as_json=as_json)


@dataclass(frozen=True, slots=True)
class NewStripOptions:
    """Options of the command `cell strips new`."""

    strip: Annotated[
        str, typer.Argument(metavar="NAME", help="What to call the strip.")
    ]
    length: Annotated[
        float,
        length_option("--length", "Fixed edge to grasped edge, as 600mm or 0.6 [m]."),
    ]
    width: Annotated[float, length_option("--width", "Width [m].")]
    areal_density: Annotated[
        float | None, typer.Option(help="Mass per area [kg/m^2].")
    ] = None
    bending_length: Annotated[
        float | None, length_option("--bending-length", "Bending length [m].")
    ] = None
    retardation_time: Annotated[
        float | None, typer.Option(help="Retardation time [s].")
    ] = None
    thickness: Annotated[
        float | None, length_option("--thickness", "Thickness [m].")
    ] = None
    colour: Annotated[
        tuple[int, int, int] | None,
        typer.Option(metavar="R G B", help="Red, green, blue, 0 to 255."),
    ] = None
    source: Annotated[
        list[str] | None,
        typer.Option(
            help="KEY=TEXT, where a value comes from; repeatable [default: measured]."
        ),
    ] = None
    configs: Configs = None


@strips.command()
@taking(NewStripOptions)
def new(given: NewStripOptions) -> None:
    """Write the file of a new strip; values that are not given are assumed, and marked
    so.
    """
    from cell.setup.strips.edit import SOURCED, new_strip

    _check_name(given.strip)
    path = writable(given.configs).folder / "strips" / f"{given.strip}.yaml"
    values = {key: getattr(given, key) for key in ("length", "width", *SOURCED)}
    new_strip(path, values, given.colour, given.source or [])
    assumed = [key for key, value in values.items() if value is None]
    print(path)
    if assumed:
        print(f"  assumed, not measured: {', '.join(assumed)}")


def _check_name(strip: str) -> None:
    """Raise ConfigurationError for a name that no file of a strip can have."""
    if NAME_PATTERN.fullmatch(strip) is None:
        raise ConfigurationError(
            f"{strip!r}: is not a name of a strip; use letters, digits, - and _, not"
            " `unknown`"
        )
