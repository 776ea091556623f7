"""A calibration in use: foreign and expired ones are refused, its facts go into the
run.
"""

from datetime import UTC, datetime, timedelta

import pytest

from calibration.calibration import Calibration
from cell.setup.calibration_in_use import check_current, record_entry
from drivers.base.errors import PreflightRefused
from tests.cell.conftest import straight_camera

NOW = datetime(2026, 11, 20, 12, 0, tzinfo=UTC)


def made(**facts: object) -> Calibration:
    known = {"residual_mm": 0.2, "date": "2026-11-18T12:00:00+00:00", "camera": "one"}
    return straight_camera(**known | facts)


def test_expired_calibration_is_refused_on_hardware_before_anything_moves() -> None:
    late = NOW + timedelta(days=29)
    with pytest.raises(
        PreflightRefused, match="is 31 days old, allowed are 30"
    ) as caught:
        check_current(made(), 30, late, on_twin=False)
    assert caught.value.exit_code == 3
    check_current(made(), 30, late, on_twin=True)  # whose camera nobody moves


def test_run_records_id_residual_latency_and_age() -> None:
    calibration = made(latency=0.031)
    assert record_entry(calibration, NOW) == {
        "id": calibration.id,
        "error": 0.0002,
        "latency": 0.031,
        "date": "2026-11-18T12:00:00+00:00",
        "age_days": 2.0,
    }
