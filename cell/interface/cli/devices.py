"""Commands `cell doctor`, which checks machine and devices, and `cell camera`."""

import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.base.config.places import find_configs
from cell.interface.cli.options import Arm, Camera, Configs, Json, Runs
from cell.interface.cli.output import notice, print_json, say, while_busy
from cell.record.files import run_folder
from drivers.base.errors import ConfigurationError, PreflightRefused, in_ms

if TYPE_CHECKING:
    from calibration.calibration import Calibration
    from drivers.base.types import Frame
    from drivers.v4l2.camera import CameraReport, UnusableDevice
    from drivers.v4l2.settings import V4l2Settings


def doctor(
    arm: Arm = None,
    camera: Camera = None,
    runs: Runs = Path("runs"),
    configs: Configs = None,
    seconds: Annotated[
        float,
        typer.Option(
            min=1, max=3600, help="How long the network to the robot is tested."
        ),
    ] = 10.0,
    as_json: Json = False,
) -> None:
    """Check machine, files, robot and camera; prints findings, reasons and remedies."""
    from cell.setup.doctor.check import Grade
    from cell.setup.doctor.doctor import checks

    states = set()
    found = checks(find_configs(configs), runs, seconds, arm=arm, camera=camera)
    for number, check in enumerate(while_busy("checking", found), start=1):
        states.add(check.state)
        say(check.line(number), check.text(number), as_json=as_json)
        sys.stdout.flush()
    if Grade.FAIL in states:
        sys.exit(PreflightRefused.exit_code)


PINNED = Path("calibrations/view.png")
Device = Annotated[
    str | None,
    typer.Option(
        help="Camera by its link, /dev/v4l/by-id/... [default: that of cell.yaml]."
    ),
]

camera = typer.Typer()


@camera.callback(invoke_without_command=True)
def list_or_grab(
    context: typer.Context,
    device: Device = None,
    grab: Annotated[
        Path | None, typer.Option(help="Take a picture into this PNG file.")
    ] = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """List cameras with their formats and controls, or take a picture with one of
    them; `check` tells whether it has moved.
    """
    if (command := context.invoked_subcommand) is not None:
        if (device, grab, configs, as_json) != (None, None, None, False):
            raise ConfigurationError(f"cell camera: give options after `{command}`")
        return
    if grab is not None:
        _grab(_settings(device, configs), grab, as_json=as_json)
        return
    from drivers.v4l2.camera import list_cameras, report
    from drivers.v4l2.device import Kernel

    found = (
        list_cameras(Kernel()) if device is None else iter([report(Kernel(), device)])
    )
    _print_cameras(found, as_json=as_json)


@camera.command(name="check")
def check_camera(
    film: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILM", parser=run_folder, help="A run, last, or a film."
        ),
    ] = None,
    pin: Annotated[
        bool, typer.Option("--pin", help="Pin the present view anew.")
    ] = False,
    view: Annotated[
        Path | None,
        typer.Option(
            help="Picture of the pinned view [default: calibrations/view.png; of a"
            " film its first image]."
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the motion into this PNG file.")
    ] = None,
    device: Device = None,
    camera: Camera = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Say how far the camera has moved since its view was pinned, which the first call
    does, or in the course of a film.
    """
    from calibration.wizard.session import as_png
    from cell.setup.camera_check import check_views
    from drivers.base.outputs import check_output, write_output
    from drivers.base.readers import read_picture

    if film is not None and pin:
        raise ConfigurationError("--pin: pins what the camera sees; name no film")
    if picture is not None:
        check_output(picture)
    if film is None:
        view = view or PINNED
        frame, calibration = _seen(device, camera, configs)
        frames: Iterable[Frame] = [frame]
        if pin or not view.exists():
            write_output(view, as_png(frame.image))
            facts = {"pinned": view}
            say(facts, f"pinned: {view}; call it again to compare", as_json=as_json)
            return
    else:
        frames, calibration = _filmed(film)
    pinned = None if view is None else read_picture(view)
    check = check_views(pinned, frames, calibration)
    if picture is not None:
        write_output(picture, as_png(check.picture()))
    say(check.facts(), check.sentence(), as_json=as_json)
    sys.exit(0 if check.passed else 1)


def _seen(
    device: str | None, camera: str | None, configs: Path | None
) -> "tuple[Frame, Calibration | None]":
    """Image that the cell's camera takes now, and its calibration if it has one."""
    from cell.base.devices.devices import Trial
    from cell.base.devices.open import NO_STRIP, open_cell
    from cell.setup.calibration_in_use import calibration_of
    from cell.setup.camera_check import take_view

    settings = find_configs(configs).cell()
    if device is not None:
        camera = "v4l2"
        own = {"camera": _settings(device, configs)}
        settings = settings.model_copy(update=own)
    settings = settings.with_drivers("twin", camera)  # no arm is needed
    devices = open_cell(settings, NO_STRIP, Trial(), calibrating=True)
    frame = take_view(devices)
    if settings.camera_driver.real and settings.calibration is None:
        return frame, None
    calibration = calibration_of(settings, notice)
    own_camera = calibration.camera == devices.camera_identity
    return frame, calibration if own_camera else None


def _filmed(film: Path) -> "tuple[Iterator[Frame], Calibration | None]":
    """Images of a `film`, or of that of a run, and the run's calibration."""
    from cell.record.files import is_run
    from cell.record.film import Film
    from cell.record.run import read_run
    from cell.setup.camera_check import every_second

    if not is_run(film):
        return every_second(Film(film).frames()), None
    run = read_run(film)
    return every_second(run.film_frames()), run.calibration()


def _settings(device: str | None, configs: Path | None) -> "V4l2Settings":
    """Settings of the camera in cell.yaml, or suitable ones for another camera
    `device`.
    """
    from cell.base.devices.real_camera import suggest_settings
    from drivers.v4l2.camera import report
    from drivers.v4l2.device import Kernel

    own = find_configs(configs).cell().camera
    if own is not None and device in {None, own.device}:
        return own
    if device is None:
        raise ConfigurationError(
            "--device: cell.yaml names no camera; name one that `cell camera` lists"
        )
    settings = suggest_settings(report(Kernel(), device))
    if settings is None:
        raise ConfigurationError(f"{device}: offers no format that this driver reads")
    return settings


def _grab(settings: "V4l2Settings", path: Path, *, as_json: bool) -> None:
    """Take a picture with the camera of `settings` into the PNG file at `path`."""
    from calibration.wizard.session import as_png
    from cell.base.devices.real_camera import grab
    from drivers.base.outputs import check_output, write_output

    check_output(path)
    taken = grab(settings)
    write_output(path, as_png(taken.frame.image))
    counts = taken.counts
    picture = taken.setup.picture
    stated = taken.setup.locks
    if as_json:
        facts = {
            "measured_rate": taken.rate,
            "age": taken.age,
            "counts": asdict(counts),
            "stamp_source": taken.frame.stamp_source,
            "locks": dict(stated),
        }
        print_json({"file": path, **asdict(picture), **facts})
        return
    locks = ", ".join(f"{name} {value}" for name, value in stated.items())
    print(
        f"{path}: {picture.format} {picture.width}x{picture.height} of"
        f" {settings.device}\n  {taken.rate:.1f} Hz by the stamps, {picture.rate:g}"
        f" agreed; known {in_ms(taken.age)} after the middle of the exposure,"
        f" stamped by the {taken.frame.stamp_source}\n  {counts.arrived} frames,"
        f" {counts.missing} missing, {counts.corrupt} corrupt, {counts.restamped}"
        f" without a stamp to trust\n  locked: {locks or 'nothing'}"
    )


def _print_cameras(
    found: "Iterator[CameraReport | UnusableDevice]", *, as_json: bool
) -> None:
    """Print cameras with their formats and controls."""
    from drivers.v4l2.camera import UnusableDevice

    cameras = list(found)
    for entry in cameras:
        if as_json:
            facts = asdict(entry)
            if not isinstance(entry, UnusableDevice):
                facts["camera"] = _mode_facts(entry)
            print_json(facts)
        elif isinstance(entry, UnusableDevice):
            print(entry.problem)
        else:
            print("\n".join(_camera_lines(entry)))
    if not cameras:
        raise ConfigurationError("no camera has a link under /dev/v4l; plug one in")


def _mode_facts(entry: "CameraReport") -> dict[str, Any] | None:
    """Section `camera` of cell.yaml that suits a camera; None without a format that can
    be read.
    """
    from cell.base.devices.real_camera import suggest_settings

    settings = suggest_settings(entry)
    return None if settings is None else settings.model_dump(exclude_defaults=True)


def _camera_lines(entry: "CameraReport") -> Iterator[str]:
    """Yield lines on one camera: formats, controls, and settings for cell.yaml."""
    from drivers.v4l2.formats import READABLE_FORMATS

    identity = entry.identity
    yield f"{entry.device}: {identity.card} ({identity.driver}, {identity.bus})"
    yield "  formats"
    yield from (
        f"    {mode} Hz" for mode in entry.modes if mode.format in READABLE_FORMATS
    )
    others = {
        mode.format: None for mode in entry.modes if mode.format not in READABLE_FORMATS
    }
    if others:
        yield f"    not read by this driver: {', '.join(others)}"
    yield "  controls"
    for control in entry.controls:
        value = "-" if control.value is None else control.value
        obstacle = "" if control.obstacle is None else f"; {control.obstacle}"
        yield f"    {control.name} {value} ({control.allowed}{obstacle})"
    section = _mode_facts(entry)
    if section is None:
        yield "  offers no format that this driver reads"
    else:
        yield f"  to use it, in cell.yaml\n    camera: {json.dumps(section)}"
