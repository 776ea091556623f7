"""The doctor finds what would hurt, says what to do, and no real fold begins while it
is red.
"""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.calibration import save_calibration
from cell.interface.cli.app import app
from cell.setup.doctor import devices, machine
from cell.setup.doctor.check import FAIL, PASS, SKIPPED, WARN, Check, Grade
from cell.setup.doctor.devices import NetworkLink, judge_link, link_of, measure_link
from cell.setup.doctor.doctor import checks, refuse_failed
from drivers.base.errors import CellError, PreflightRefused
from drivers.twin.fci_server.server import RobotServer
from tests.cell.conftest import straight_camera
from tests.support.requests import CELL, CONFIGS
from tests.support.run_edits import edit_yaml


def kept(folder: Path, **facts: str) -> Path:
    """A calibration's file in `folder`."""
    save_calibration(straight_camera(**facts), folder / "calibration.yaml")
    return folder / "calibration.yaml"


def arrivals(lost: range = range(0), late: float = 0.0) -> NetworkLink:
    """Two seconds of states, those in `lost` missing, every tenth one `late` [ms]."""
    times = np.array([t for t in range(2000) if t not in lost])
    return link_of(times, 1e-3 * times + 1e-3 * late * (times % 10 == 0))


@pytest.mark.parametrize(
    ("link", "state"),
    [
        (arrivals(), PASS),
        (arrivals(lost=range(1000, 1015)), PASS),
        (arrivals(lost=range(1000, 1020)), FAIL),
        (arrivals(late=3.0), WARN),
        (arrivals(lost=range(400, 2000, 8)), FAIL),
    ],
)
def test_link_is_judged_by_what_the_robot_asks(link: NetworkLink, state: Grade) -> None:
    check = judge_link(link)
    assert check.state is state
    assert check.remedy


def test_states_of_the_served_robot_arrive_over_loopback() -> None:
    pytest.importorskip("pylibfranka")
    with RobotServer() as server:
        link = measure_link(server.address, 1.0)
    assert link.states > 100
    assert link.seconds == pytest.approx(1.0, abs=0.3)


def test_robot_that_is_not_there_is_one_line() -> None:
    pytest.importorskip("pylibfranka")
    with pytest.raises(CellError) as refused:
        measure_link("127.0.0.99", 1.0)
    assert "\n" not in str(refused.value)
    check = devices.robot("127.0.0.99")
    assert (check.state, "no robot answers" in check.found) == (FAIL, True)


def test_calibration_that_has_expired_is_red(tmp_path: Path) -> None:
    old = (datetime.now(UTC) - timedelta(days=400)).isoformat()
    settings = CELL.model_copy(update={"calibration": str(kept(tmp_path, date=old))})
    assert devices.calibration(settings, on_twin=True).state is PASS
    check = devices.calibration(settings, on_twin=False)
    assert (check.state, "400 days" in check.found) == (FAIL, True)


def test_disk_without_room_is_red(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert machine.disk(tmp_path / "runs").state is not FAIL
    monkeypatch.setattr(machine, "RUN_GB", 1e9)
    assert machine.disk(tmp_path / "runs").state is FAIL


def test_cell_of_the_twin_needs_no_hardware(tmp_path: Path) -> None:
    found = list(checks(CONFIGS, tmp_path))
    assert [c.state for c in found if c.name in {"robot", "camera"}] == [SKIPPED] * 2
    refuse_failed([check for check in found if check.name != "cores"])


@pytest.mark.parametrize(
    ("rate", "missing", "state"),
    [(29.9, 0, PASS), (27.0, 0, WARN), (29.9, 1, WARN)],
)
def test_camera_that_is_slow_or_loses_pictures_is_told(
    rate, missing, state, monkeypatch
) -> None:
    picture = SimpleNamespace(rate=30.0)
    counts = SimpleNamespace(missing=missing, corrupt=0, restamped=0)
    taken = SimpleNamespace(rate=rate, age=0.03, counts=counts)
    taken.setup = SimpleNamespace(picture=picture)
    taken.frame = SimpleNamespace(stamp_source="driver")
    monkeypatch.setattr(devices, "grab", lambda _: taken)
    check = devices.camera_stream(SimpleNamespace(camera="a device"))
    assert check.state is state
    assert "stamped by the driver" in check.found


def test_governor_that_slows_the_processor_is_told(tmp_path, monkeypatch) -> None:
    told = tmp_path / "scaling_governor"
    told.write_text("powersave\n")
    monkeypatch.setattr(machine, "GOVERNORS", (told,))
    assert machine.governor().state is WARN
    told.write_text("performance\n")
    assert machine.governor().state is PASS


def test_drivers_on_the_command_line_are_the_ones_checked(tmp_path: Path) -> None:
    found = checks(CONFIGS, tmp_path, camera="v4l2")
    camera = next(check for check in found if check.name == "camera")
    assert camera.state is FAIL
    assert "cell camera" in camera.remedy


def test_red_check_refuses_with_its_remedy() -> None:
    red = Check("camera", FAIL, "is gone", "it sees", "connect it")
    with pytest.raises(PreflightRefused, match=r"camera: is gone; connect it"):
        refuse_failed([red])


def test_command_prints_an_object_a_line(tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        app(["doctor", "--json", "--runs", str(tmp_path)])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["number"] for line in lines] == list(range(1, len(lines) + 1))
    assert all(line["remedy"] for line in lines if line["state"] in ("warn", "fail"))
    red = any(line["state"] == "fail" for line in lines)
    assert (ended.value.code or 0) == (PreflightRefused.exit_code if red else 0)


def test_fold_with_a_real_camera_refuses_while_a_check_is_red(
    tmp_path: Path, configs: Path
) -> None:
    camera = {"device": "/dev/v4l/by-id/none", "format": "YUYV"}
    edit_yaml(
        configs / "cell.yaml",
        drivers={"arm": "twin", "camera": "v4l2"},
        camera=camera | {"width": 1280, "height": 720, "rate": 30.0},
        calibration=str(kept(tmp_path)),
    )
    with pytest.raises(PreflightRefused, match="cell doctor"):
        app(f"fold --strip denim --configs {configs} --runs {tmp_path}/r".split())
    assert not (tmp_path / "r").exists()
