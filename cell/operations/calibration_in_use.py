"""Validity of a calibration, and its entry in the record."""

from datetime import UTC, datetime
from typing import Any

from calibration.calibration import Calibration
from cell.devices.devices import Devices
from drivers.errors import ConfigurationError, PreflightRefused

DAY = 86400.0  # s
ANEW = "run `cell calibrate camera` and `cell calibrate homography`, name the file in cell.yaml"


def age_days(calibration: Calibration, now: datetime) -> float:
    """Age [days] at `now`; a date that cannot be read is a ConfigurationError."""
    try:
        made = datetime.fromisoformat(calibration.date)
    except ValueError:
        raise ConfigurationError(
            f"calibration: date: {calibration.date!r} is no ISO 8601 date; {ANEW}"
        ) from None
    made = made if made.tzinfo is not None else made.replace(tzinfo=UTC)
    return (now - made).total_seconds() / DAY


def check_usable(
    calibration: Calibration, devices: Devices, allowed_days: float, now: datetime
) -> None:
    """Refuse a calibration of another camera, and on hardware one that has expired.

    Raises ConfigurationError and PreflightRefused.
    """
    if calibration.camera != devices.camera_identity:
        raise ConfigurationError(
            f"calibration: {calibration.id} belongs to camera {calibration.camera}, this one is "
            f"{devices.camera_identity}; run `cell calibrate` and name its file, or none"
        )
    on_twin = devices.plant is not None
    age = age_days(calibration, now)
    if not on_twin and age > allowed_days:
        raise PreflightRefused(
            f"calibration: {calibration.id} is {age:.0f} days old, allowed are "
            f"{allowed_days:.0f} (calibration_days in cell.yaml); {ANEW}"
        )


def recorded(calibration: Calibration, now: datetime) -> dict[str, Any]:
    """Entry of run.yaml about a calibration: id, error [m], age, reason of an override."""
    facts: dict[str, Any] = {
        "id": calibration.id,
        "error": calibration.residual_mm / 1e3,
        "latency": calibration.latency,
        "date": calibration.date,
        "age_days": round(age_days(calibration, now), 3),
    }
    if calibration.accepted_anyway:
        facts["accepted_anyway"] = list(calibration.accepted_anyway)
    return facts
