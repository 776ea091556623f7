"""Calibration of a cell's camera without an operator, under the orchestrator's monitors."""

import fcntl
import hashlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from calibration.calibration import Calibration, load_calibration, save_calibration
from calibration.lens import Lens
from cell.config.cell import CellFile
from cell.config.places import CHECKOUT_CONFIGS, PACKAGED, cache_folder
from cell.devices.devices import CalibrationAids, DeviceSelection
from cell.devices.open import open_cell
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Unattended
from drivers.errors import CellError, ConfigurationError
from drivers.files import check_writable
from drivers.strip.file import StripFile

SHIPPED = (PACKAGED if PACKAGED.exists() else CHECKOUT_CONFIGS) / "calibration"
RENDERING = 1  # raised with a renderer by which calibrations come out otherwise; a test says when
NO_STRIP = StripFile(
    schema=1,
    name="none",
    length=0.6,
    width=0.05,
    areal_density=0.2,
    bending_length=0.02,
    retardation_time=0.03,
)  # the desk is bare while the camera is calibrated


def calibration_of(
    settings: CellFile,
    report: Callable[[str], None] = lambda _: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Calibration:
    """Load the calibration that the cell uses, or make one on the twin.

    That of the cell file if it names one; else, on the twin, one made with boards and touched
    points before: for the next run, or for the shipped settings, with which it comes. `report` is
    called with a message when one is made, and when it cannot be kept. Raises Interrupted when
    `interrupted` while it is made.
    """
    if settings.calibration is not None:
        return load_calibration(Path(settings.calibration))
    path = kept_calibration(settings)
    with _file_lock(path):
        for known in (path, SHIPPED / path.name):
            with suppress(ConfigurationError):
                return load_calibration(known)
        report("this twin has no calibration yet: its camera is calibrated first")
        made = calibrate_now(settings, interrupted)
        try:
            save_calibration(made, path)
        except ConfigurationError as error:
            report(f"{error}; this calibration serves once, the next run calibrates again")
    return made


def calibrate_anew(
    settings: CellFile, interrupted: Callable[[], bool] = lambda: False
) -> tuple[Calibration, Path]:
    """Calibrate the twin and keep the result for later runs; returns it and its file's path."""
    path = kept_calibration(settings)
    made = calibrate_now(settings, interrupted)
    save_calibration(made, path)
    return made, path


@contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    """Within the block, lock the file at `path` against other processes, where locks exist."""
    with ExitStack() as held:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = path.with_suffix(".lock")
            check_writable(lock)
            fcntl.flock(held.enter_context(lock.open("rb")), fcntl.LOCK_EX)
        yield


def kept_calibration(settings: CellFile) -> Path:
    """Path at which the twin's calibration is kept, unique to its settings and its renderer."""
    facts = settings.model_dump_json(include={"twin", "touches", "boards", "latency"})
    identity = hashlib.sha256(f"{facts}{RENDERING}".encode()).hexdigest()[:12]
    return cache_folder() / "calibration" / f"twin-{identity}.yaml"


def calibrate_now(settings: CellFile, interrupted: Callable[[], bool]) -> Calibration:
    """Calibrate lens and homography of the twin's camera without keeping the result.

    Raises CellError when they are not good enough, Fault when a monitor stopped the arm, and
    Interrupted when the operator did.
    """
    from calibration.wizard.touch_verdict import refusals
    from calibration.wizard.touched_points import TouchedPoints
    from cell.calibrating.keyboard import TwinOperator
    from cell.calibrating.wizard import build_calibration, touch_all

    twin = DeviceSelection(arm="twin", camera="twin")
    devices = open_cell(settings, NO_STRIP, twin, calibrating=True)
    if devices.aids is None:
        raise ConfigurationError("calibrate: nobody holds the board; use the wizard")
    lens = lens_from_boards(settings, devices.aids)
    points = TouchedPoints(lens, settings.touches)
    operator = TwinOperator(devices.aids, Unattended())
    context = CalibrationContext(settings.controller, points, operator)
    found = touch_all(devices, context, interrupted), context.latency
    made = build_calibration(lens, *found, devices.camera_identity)
    if made is None:
        raise CellError("homography failed: " + "; ".join(refusals(*found)))
    return made


def lens_from_boards(settings: CellFile, aids: CalibrationAids) -> Lens:
    """Fit the lens to as many board views as it takes; raises CellError for a poor result."""
    from calibration.wizard.board_views import BoardViews
    from calibration.wizard.progress import ignore
    from cell.calibrating.wizard import show_board

    views = BoardViews(settings.boards)
    show_board(views, aids.show_board, Unattended(), ignore)
    verdict = views.verdict(aids.measure_board())
    if verdict.fit is None or not verdict.passed:
        raise CellError("lens calibration failed: " + "; ".join(verdict.reasons))
    return verdict.fit.lens
