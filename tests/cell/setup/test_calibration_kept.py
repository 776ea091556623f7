"""A calibration in use: the twin's comes with its settings, or is made once and kept; one
that is foreign or expired is refused; its facts go into the run.
"""

import fcntl
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from calibration.calibration import Calibration, load_calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import CHECKOUT_CONFIGS
from cell.folding.fold import fold
from cell.orchestrator.operator import Interrupted
from cell.setup import calibration_in_use, wizard
from cell.setup.calibration_in_use import (
    calibration_file,
    calibration_of,
    check_current,
    record_entry,
)
from cell.setup.wizard import calibrate_twin
from drivers.base.errors import Fault, PreflightRefused
from tests.cell.conftest import straight_camera
from tests.support.refusals import refusal
from tests.support.requests import CELL, request_for
from tests.support.twin_calibration import SHIPPED


def made(camera: str = CELL.twin.camera.identity) -> Calibration:
    return straight_camera(date="2026-11-20T03:15:00+00:00", camera=camera)


@pytest.fixture
def cache(monkeypatch, tmp_path) -> Path:
    """Where a calibration is kept; none is shipped."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(calibration_in_use, "SHIPPED", tmp_path / "nowhere")
    return tmp_path / "cache"


@pytest.fixture
def count(monkeypatch) -> list[CellFile]:
    """Every calibration that was made, which here takes no time."""
    calls: list[CellFile] = []

    def make(settings: CellFile, interrupted: object) -> Calibration:
        calls.append(settings)
        return made()

    monkeypatch.setattr(wizard, "calibrate_twin", make)
    return calls


def test_the_shipped_one_serves_the_shipped_settings(cache, count, monkeypatch) -> None:
    """Where this fails, write it anew: `python -m tests.support.twin_calibration`."""
    monkeypatch.setattr(calibration_in_use, "SHIPPED", SHIPPED)
    (shipped,) = SHIPPED.iterdir()
    assert shipped.name == calibration_file(CELL).name
    assert calibration_of(CELL).id == load_calibration(shipped).id
    assert not count


@pytest.mark.slow
def test_the_shipped_one_is_what_calibrating_gives(cache) -> None:
    """Where this fails, raise `RENDERING`, and write it anew as above."""
    (shipped,) = SHIPPED.iterdir()
    places = np.stack(np.meshgrid(np.linspace(0, 0.6, 7), np.linspace(0, 0.3, 4)), -1)
    known, found = load_calibration(shipped), calibrate_twin(CELL, lambda: False)
    assert np.abs(found.to_image(places) - known.to_image(places)).max() < 1e-3  # px


@pytest.mark.parametrize("change", ["camera", "renderer"])
def test_another_camera_or_renderer_is_calibrated_anew(
    cache, count, monkeypatch, change
) -> None:
    monkeypatch.setattr(calibration_in_use, "SHIPPED", SHIPPED)
    settings = CELL
    if change == "camera":
        camera = settings.twin.camera.model_copy(update={"yaw": 0.01})
        twin = settings.twin.model_copy(update={"camera": camera})
        settings = settings.model_copy(update={"twin": twin})
    else:
        monkeypatch.setattr(
            calibration_in_use, "RENDERING", calibration_in_use.RENDERING + 1
        )
    calibration_of(settings)
    assert len(count) == 1


def test_it_is_made_once_and_then_kept(cache, count) -> None:
    first, second = calibration_of(CELL), calibration_of(CELL)
    assert len(count) == 1
    assert first.id == second.id


def test_calibration_that_cannot_be_kept_serves_once_with_a_remark(
    cache, count
) -> None:
    cache.write_text("a file where a folder should be")
    remarks: list[str] = []
    assert calibration_of(CELL, remarks.append).id == made().id
    assert "its camera is calibrated first" in remarks[0]
    assert str(cache) in remarks[1]


def test_while_one_process_makes_it_others_wait(cache, monkeypatch) -> None:
    def make(settings: CellFile, interrupted: object) -> Calibration:
        lock = calibration_file(settings).with_suffix(".lock")
        with lock.open("wb") as another, pytest.raises(BlockingIOError):
            fcntl.flock(another, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return made()

    monkeypatch.setattr(wizard, "calibrate_twin", make)
    assert calibration_of(CELL).id == made().id
    with calibration_file(CELL).with_suffix(".lock").open("wb") as another:
        fcntl.flock(another, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_one_of_another_camera_is_refused_before_anything_is_recorded(tmp_path) -> None:
    request = request_for("denim", "triangular", tmp_path / "runs", CHECKOUT_CONFIGS)
    with refusal(r"another.*cell calibrate"):
        fold(request, made(camera="another"))
    assert not (tmp_path / "runs").exists()


def test_ctrl_c_stops_a_calibration_under_control(cache, monkeypatch) -> None:
    monkeypatch.setattr(wizard, "lens_from_boards", lambda settings, aids: made().lens)
    with pytest.raises(Interrupted, match="interrupted") as stopped:
        calibration_of(CELL, interrupted=lambda: True)
    assert stopped.value.exit_code == 130
    assert not calibration_file(CELL).exists()


def test_a_monitor_that_stops_a_calibration_is_a_fault(cache, monkeypatch) -> None:
    limits = CELL.monitors.model_copy(update={"tracking_error": 1e-9})
    monkeypatch.setattr(wizard, "lens_from_boards", lambda settings, aids: made().lens)
    with pytest.raises(Fault, match="tracking_error") as stopped:
        calibration_of(CELL.model_copy(update={"monitors": limits}))
    assert stopped.value.exit_code == 4
    assert not calibration_file(CELL).exists()


NOW = datetime(2026, 11, 20, 12, 0, tzinfo=UTC)


def dated(**facts: object) -> Calibration:
    known = {"residual_mm": 0.2, "date": "2026-11-18T12:00:00+00:00", "camera": "one"}
    return straight_camera(**known | facts)


def test_expired_calibration_is_refused_on_hardware_before_anything_moves() -> None:
    late = NOW + timedelta(days=29)
    with pytest.raises(
        PreflightRefused, match="is 31 days old, allowed are 30"
    ) as caught:
        check_current(dated(), 30, late, on_twin=False)
    assert caught.value.exit_code == 3
    check_current(dated(), 30, late, on_twin=True)  # whose camera nobody moves


def test_run_records_id_residual_latency_and_age() -> None:
    calibration = dated(latency=0.031)
    assert record_entry(calibration, NOW) == {
        "id": calibration.id,
        "error": 0.0002,
        "latency": 0.031,
        "date": "2026-11-18T12:00:00+00:00",
        "age_days": 2.0,
    }


def test_a_lock_on_a_calibration_is_one_process_s_alone(tmp_path: Path) -> None:
    path = tmp_path / "calibration.yaml"
    with calibration_in_use._file_lock(path):
        other = path.with_suffix(".lock").open("rb")
        with other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_SH | fcntl.LOCK_NB)
