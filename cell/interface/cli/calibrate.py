"""Commands `cell calibrate`: calibration of the twin, and of a camera by a wizard."""

import sys
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from cell.base.config.places import find_configs
from cell.interface.cli import options
from cell.interface.cli.output import notice, print_json
from drivers.base.errors import ConfigurationError, in_mm

if TYPE_CHECKING:
    from calibration.board import BoardSettings
    from calibration.calibration import Calibration
    from calibration.wizard.lens_verdict import LensVerdict
    from calibration.wizard.touch_verdict import MapVerdict
    from cell.base.config.cell import CellFile
    from cell.base.devices.devices import Devices

SHORTEST_BOARD = 1e-3  # m
SESSIONS = Path("calibrations")
FIRST_LINE = (
    "Calibrate the camera: `camera` its lens, `homography` its place; `check`"
    " touches it."
)

Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder of this session, new [default: calibrations/TIME-CELL-KIND]."
    ),
]
From = Annotated[
    Path | None,
    typer.Option("--from", help="Solve the session in this folder again instead."),
]
Resume = Annotated[
    Path | None,
    typer.Option(
        help="Go on with the interrupted session in this folder; it keeps its settings."
    ),
]
Without = Annotated[
    list[int] | None,
    typer.Option(
        help="With --from: leave the image or point with this number out; repeatable."
    ),
]
Interactive = Annotated[
    bool, typer.Option("--interactive", help="Ask before each step on the twin too.")
]

PrintTo = Annotated[
    Path | None,
    typer.Option("--print", help="Only write the board as a PDF of true size."),
]
BoardLength = Annotated[
    float | None,
    options.length_option(
        "--measured",
        "Length of all columns of squares by a ruler, as 252.0mm [mm].",
        "mm",
        SHORTEST_BOARD,
    ),
]

calibrate = typer.Typer(help=FIRST_LINE)


@calibrate.callback(invoke_without_command=True)
def calibrate_twin_camera(
    context: typer.Context,
    out: Annotated[
        Path | None, typer.Option(help="Also write the calibration here.")
    ] = None,
    configs: options.Configs = None,
) -> None:
    """Without a further command: calibrate the twin's camera anew, for all later
    folds.
    """
    if (command := context.invoked_subcommand) is not None:
        if out is not None or configs is not None:
            raise ConfigurationError(f"cell calibrate: give options after `{command}`")
        return
    from calibration.calibration import save_calibration
    from cell.orchestrator.operator import Interrupt
    from cell.setup.calibration_in_use import calibration_file
    from cell.setup.wizard import calibrate_twin

    settings = find_configs(configs).cell()
    path = calibration_file(settings)
    with Interrupt() as interrupted:
        made = calibrate_twin(settings, interrupted)
    save_calibration(made, path)
    if out is not None:
        save_calibration(made, out)
    print(
        f"calibrated: {made.residual_mm:.2f} mm rms at points not used in the fit\n "
        f" {path}"
    )


@calibrate.command(name="camera")
def calibrate_camera(
    print_to: PrintTo = None,
    measured: BoardLength = None,
    camera: options.Camera = None,
    out: Out = None,
    again: From = None,
    without: Without = None,
    resume: Resume = None,
    interactive: Interactive = False,
    viz: options.VizOption = "save",
    configs: options.Configs = None,
    as_json: options.Json = False,
) -> None:
    """Find the camera's lens from views of a ChArUco board; says which view is next,
    and why.
    """
    from cell.setup.wizard import ROS, solve_lens
    from cell.setup.wizard_panel import wizard_at_terminal

    settings = find_configs(configs).cell()
    if print_to is not None:
        _print_board(settings, print_to)
        return
    if again is not None:
        folder = out
        verdict = solve_lens(again, without or (), out)
    else:
        folder = _session_folder(out, resume, settings.name, "camera")
        settings, devices = _open_devices(settings, "twin", camera)  # no arm is needed
        if measured is None and devices.aids is None and resume is None:
            raise _unmeasured(settings.boards)
        with wizard_at_terminal(
            settings,
            devices,
            interactive=interactive,
            session=(folder, "camera"),
            viz=viz,
        ) as wizard:
            verdict = wizard.calibrate_lens(folder, measured)

    _print_session(verdict, folder, as_json=as_json)
    if folder is not None and verdict.passed and not as_json:
        print(f"next: cell calibrate homography --lens {quote(str(folder / ROS))}")
    sys.exit(not verdict.passed)


def _unmeasured(boards: "BoardSettings") -> ConfigurationError:
    """Error that the length of a real board was not measured by a ruler."""
    return ConfigurationError(
        f"--measured: lay a ruler along {boards.columns} squares of the board, and"
        f" state their length; {1e3 * boards.width:.1f}mm are configured"
    )


@dataclass(frozen=True, slots=True)
class HomographyOptions:
    """Options of the command `cell calibrate homography`."""

    lens: Annotated[
        Path | None,
        typer.Option(
            help="Lens file of ROS or OpenCV [default: the newest in calibrations/]."
        ),
    ] = None
    poses: Annotated[
        Path | None,
        typer.Option(help="Touch the poses of this file, an edited poses.yaml."),
    ] = None
    accept_anyway: Annotated[
        bool,
        typer.Option(
            "--accept-anyway",
            help="Take a refused calibration; every run then says so.",
        ),
    ] = False
    arm: options.Arm = None
    full_speed: options.FullSpeed = False
    camera: options.Camera = None
    out: Out = None
    again: From = None
    without: Without = None
    resume: Resume = None
    use: Annotated[
        bool,
        typer.Option(
            "--use", help="Name an accepted calibration in cell.yaml, for every fold."
        ),
    ] = False
    interactive: Interactive = False
    viz: options.VizOption = "save"
    configs: options.Configs = None
    as_json: options.Json = False


@calibrate.command(name="homography")
@options.taking(HomographyOptions)
def calibrate_homography(given: HomographyOptions) -> None:
    """Find the camera's map to the strip's plane, and its latency, by touches of the
    gripper.
    """
    settings = find_configs(given.configs).cell()
    if given.use:
        options.writable(given.configs)
    folder = given.out
    if given.again is None:
        folder = _session_folder(given.out, given.resume, settings.name, "homography")
        verdict = _touch(given, settings, folder)
    else:
        from cell.setup.wizard import solve_homography

        excluded = given.without or ()
        verdict = solve_homography(
            given.again, excluded, folder, accept_anyway=given.accept_anyway
        )
    made = verdict.calibration
    in_use = None
    if given.use and made is not None:
        in_use = _use_calibration(given.configs, made, folder or given.again)
    _print_session(verdict, folder, as_json=given.as_json)
    if not given.as_json:
        _print_use(made, folder, in_use)
    sys.exit(not verdict.passed)


def _touch(
    given: HomographyOptions, settings: "CellFile", folder: Path
) -> "MapVerdict":
    """Let the gripper touch points, as `given`, in a session in `folder`; returns its
    verdict.
    """
    from calibration.lens import read_lens
    from cell.setup.wizard import newest_lens, read_poses, session_lens
    from cell.setup.wizard_panel import wizard_at_terminal

    settings, devices = _open_devices(
        settings, given.arm, given.camera, full_speed=given.full_speed
    )
    if given.resume is not None:
        lens = session_lens(given.resume)
    else:
        lens = read_lens(given.lens or newest_lens(SESSIONS, devices.camera_identity))
    plan = None if given.poses is None else read_poses(given.poses)
    session = (folder, "homography")
    with wizard_at_terminal(
        settings, devices, interactive=given.interactive, session=session, viz=given.viz
    ) as wizard:
        return wizard.calibrate_homography(
            lens, folder, plan, accept_anyway=given.accept_anyway
        )


@calibrate.command(name="check")
def calibrate_check(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE", help="calibration.yaml [default: the one that folds use]."
        ),
    ] = None,
    arm: options.Arm = None,
    full_speed: options.FullSpeed = False,
    camera: options.Camera = None,
    interactive: Interactive = False,
    configs: options.Configs = None,
    as_json: options.Json = False,
) -> None:
    """Check a calibration: touch a few points again and compare them with the image."""
    from calibration.calibration import load_calibration
    from cell.setup.calibration_in_use import calibration_of, check_camera
    from cell.setup.wizard_panel import print_verdict, wizard_at_terminal

    settings, devices = _open_devices(
        find_configs(configs).cell(), arm, camera, full_speed=full_speed
    )
    calibration = load_calibration(file) if file else calibration_of(settings, notice)
    check_camera(calibration, devices)
    with wizard_at_terminal(settings, devices, interactive=interactive) as wizard:
        verdict = wizard.check(calibration)
    if as_json:
        print_json({"calibration": calibration.id} | verdict.facts())
    else:
        print_verdict(verdict.lines())
    sys.exit(not verdict.passed)


def _session_folder(
    out: Path | None, resume: Path | None, cell: str, kind: str
) -> Path:
    """Folder of a wizard's session: of --resume, of --out if it is new, or one named by
    time.
    """
    from datetime import UTC, datetime

    from calibration.wizard.session import SESSION_FILE

    if resume is not None and out is not None:
        raise ConfigurationError("--resume: goes on in its own folder; remove --out")
    if resume is not None:
        if not (resume / SESSION_FILE).is_file():
            raise ConfigurationError(
                f"--resume: {resume} holds no session: no {SESSION_FILE}"
            )
        return resume
    if out is None:
        return SESSIONS / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{cell}-{kind}"
    is_empty_folder = out.is_dir() and not any(out.iterdir())
    if out.exists() and not is_empty_folder:
        raise ConfigurationError(f"--out: {out} is there already; name a new folder")
    return out


def _open_devices(
    settings: "CellFile",
    arm: str | None,
    camera: str | None,
    *,
    full_speed: bool = False,
) -> "tuple[CellFile, Devices]":
    """Open the cell without a strip, once doctor and operator agree; returns settings,
    devices.
    """
    from cell.base.devices.open import NO_STRIP, open_cell
    from cell.setup.arm.run_settings import agree_to_slow_motion

    settings, trial = agree_to_slow_motion(
        settings.with_drivers(arm, camera),
        options.ask,
        full_speed=full_speed,
        camera=True,
    )
    return settings, open_cell(settings, NO_STRIP, trial, calibrating=True)


def _use_calibration(
    configs: Path | None, made: "Calibration", folder: Path | None
) -> Path:
    """Name the file of calibration `made`, kept in `folder`, in cell.yaml."""
    from calibration.calibration import load_calibration
    from cell.setup.calibration_in_use import use_calibration

    file = Path() if folder is None else folder / "calibration.yaml"
    if not file.is_file() or load_calibration(file).id != made.id:
        raise ConfigurationError(
            "--use: keep this calibration in a folder first, by --out"
        )
    cell_file = find_configs(configs).cell_path
    use_calibration(cell_file, file)
    return cell_file


def _print_board(settings: "CellFile", path: Path) -> None:
    """Write the calibration board as a PDF to `path`, and print how to use it."""
    boards = settings.boards
    from calibration.board import print_board

    sheet = print_board(boards, path)
    print(
        f"{path}: print it on {sheet} at 100 %, glue it on something flat; all"
        f" {boards.columns} squares must measure"
        f" {in_mm(boards.width, 1)}"
    )


def _print_session(
    verdict: "LensVerdict | MapVerdict", folder: Path | None, *, as_json: bool
) -> None:
    """Print the verdict of a session, and the page that is written into its `folder`,
    if any.
    """
    from cell.report.calibration_page import write_session_page
    from cell.setup.wizard_panel import print_verdict

    page = None if folder is None else write_session_page(folder)
    if as_json:
        print_json(verdict.facts() | {"folder": folder})
        return
    print_verdict(verdict.lines())
    if page is not None:
        print(f"  {page}")


def _print_use(
    made: "Calibration | None", folder: Path | None, in_use: Path | None
) -> None:
    """Print how to use the calibration `made` in `folder`, or that the file `in_use`
    names it.
    """
    if made is None:
        print("not accepted; --accept-anyway takes it, and every run will say so")
    elif in_use is not None:
        print(f"in use: {in_use} names it")
    elif folder is None:
        print("name a folder with --out to keep it")
    else:
        if made.accepted_anyway:
            print("accepted in spite of this; every run will say so")
        path = (folder / "calibration.yaml").resolve()
        print(f"to use it: --use, or in cell.yaml\n  calibration: {path}")
