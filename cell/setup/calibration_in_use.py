"""Calibration that a cell uses: where its file lies, making it on the twin, its
validity.
"""

import fcntl
import hashlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calibration.calibration import Calibration, load_calibration, save_calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import CHECKOUT_CONFIGS, PACKAGED, cache_folder
from cell.base.devices.devices import Devices
from drivers.base.errors import ConfigurationError, PreflightRefused
from drivers.base.files import change_file, check_writable
from drivers.base.yaml_text import edit_yaml, parse_yaml

SHIPPED = (PACKAGED if PACKAGED.exists() else CHECKOUT_CONFIGS) / "calibration"
# raised with a renderer by which calibrations come out otherwise; a test says when
RENDERING = 1
DAY = 86400.0  # s
CLOCK_TOLERANCE = 1.0  # days by which two clocks, or their time zones, may differ
# what a wizard can give: latency [s], residual [mm], bias of contact_x, distance of the
# camera [m]
LATENCY_RANGE, RESIDUAL_RANGE = (-1.0, 1.0), (0.0, 20.0)
BIAS_RANGE, DISTANCE_RANGE = (-0.05, 0.05), (0.05, 20.0)
ANEW = "run `cell calibrate camera` and `cell calibrate homography --use`"


def calibration_of(
    settings: CellFile,
    report: Callable[[str], None] = lambda _: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Calibration:
    """Load the calibration that the cell uses; where a simulated cell has none, make
    one.

    That of the cell file if it names one; else, on the twin, one made with boards and
    touched points before: for the next run, or for the shipped settings, with which it
    comes. `report` is called with a message when one is made, and when it cannot be
    kept. Raises Interrupted when `interrupted` while it is made.
    """
    if settings.calibration is not None:
        return load_calibration(Path(settings.calibration))
    from cell.setup.wizard import calibrate_twin

    path = calibration_file(settings)
    with _file_lock(path):
        for known in (path, SHIPPED / path.name):
            with suppress(ConfigurationError):
                return load_calibration(known)
        report("this twin has no calibration yet: its camera is calibrated first")
        made = calibrate_twin(settings, interrupted)
        try:
            save_calibration(made, path)
        except ConfigurationError as error:
            report(
                f"{error}; this calibration serves once, the next run calibrates again"
            )
    return made


@contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    """Context in which no other process holds the lock of the file at `path`, where the
    file system has locks.
    """
    with ExitStack() as files:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = path.with_suffix(".lock")
            check_writable(lock)
            fcntl.flock(files.enter_context(lock.open("rb")), fcntl.LOCK_EX)
        yield


def calibration_file(settings: CellFile) -> Path:
    """Path at which the calibration of a simulated cell is stored, another one for
    other settings of the simulation or of the calibration.
    """
    facts = settings.model_dump_json(include={"twin", "touches", "boards", "latency"})
    identity = hashlib.sha256(f"{facts}{RENDERING}".encode()).hexdigest()[:12]
    return cache_folder() / "calibration" / f"twin-{identity}.yaml"


def age_days(calibration: Calibration, now: datetime) -> float:
    """Age of `calibration` in days at the time `now`; ConfigurationError where its date
    cannot be read.
    """
    try:
        made = datetime.fromisoformat(calibration.date)
    except ValueError:
        raise ConfigurationError(
            f"calibration: date: {calibration.date!r} is no ISO 8601 date; {ANEW}"
        ) from None
    made = made if made.tzinfo is not None else made.replace(tzinfo=UTC)
    return (now - made).total_seconds() / DAY


def check_camera(calibration: Calibration, devices: Devices) -> None:
    """Raise ConfigurationError where `calibration` belongs to another camera than that
    of `devices`.
    """
    if calibration.camera != devices.camera_identity:
        raise ConfigurationError(
            f"calibration: {calibration.id} belongs to camera {calibration.camera},"
            f" this one is {devices.camera_identity}; run `cell calibrate` and name its"
            " file, or none"
        )


def use_calibration(cell_file: Path, calibration: Path) -> None:
    """Write the path of the file `calibration` into the cell file at `cell_file`;
    ConfigurationError where that fails.
    """
    named = {"calibration": str(calibration.resolve())}
    change_file(
        cell_file,
        lambda text: edit_yaml(text, parse_yaml(text, str(cell_file)) | named),
        f"write `calibration: {calibration.resolve()}` into it by hand",
    )


def check_current(
    calibration: Calibration, allowed_days: float, now: datetime, *, on_twin: bool
) -> None:
    """Refuse a `calibration` that is implausible, by ConfigurationError, or that on a
    real cell is older than `allowed_days`, by PreflightRefused.
    """
    _check_plausible(calibration)
    age = age_days(calibration, now)
    if age < -CLOCK_TOLERANCE:
        raise ConfigurationError(
            f"calibration: date: {calibration.date} lies in the future; set the clock,"
            f" or {ANEW}"
        )
    if not on_twin and age > allowed_days:
        raise PreflightRefused(
            f"calibration: {calibration.id} is {age:.0f} days old, allowed are "
            f"{allowed_days:.0f} (calibration_days in cell.yaml); {ANEW}"
        )


def _check_plausible(calibration: Calibration) -> None:
    """Raise ConfigurationError where some value of `calibration` lies outside the range
    that a real camera can have.
    """
    for key, value, (low, high), unit in (
        ("latency", calibration.latency, LATENCY_RANGE, "s"),
        ("residual_mm", calibration.residual_mm, RESIDUAL_RANGE, "mm"),
        ("contact_bias", calibration.contact_bias, BIAS_RANGE, "m"),
        (
            "homography: the camera's distance",
            calibration.viewpoint.distance,
            DISTANCE_RANGE,
            "m",
        ),
    ):
        if not low <= value <= high:
            raise ConfigurationError(
                f"calibration: {key}: is {value:g} {unit}, allowed {low:g} to {high:g}"
                f" {unit}; {ANEW}"
            )


def record_entry(calibration: Calibration, now: datetime) -> dict[str, Any]:
    """Entry on `calibration` in the header of a run: its identity, error [m], latency
    [s], date, age in days at the time `now`, and reasons that were overridden.
    """
    facts: dict[str, Any] = {
        "id": calibration.id,
        "error": calibration.residual,
        "latency": calibration.latency,
        "date": calibration.date,
        "age_days": round(age_days(calibration, now), 3),
    }
    if calibration.accepted_anyway:
        facts["accepted_anyway"] = list(calibration.accepted_anyway)
    return facts
