"""A fold with the real camera's driver, on a kernel whose time passes in sleeps
alone.
"""

import json
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import drivers.base.clock
import drivers.v4l2.camera
from cell.interface.cli.app import app
from drivers.v4l2.settings import V4l2Settings
from tests.drivers.v4l2.fake_kernel import LINK, FakeKernel
from tests.support.assumed_camera import configure

pytestmark = pytest.mark.slow


class KernelTime:
    """The time module, on the kernel's time; at `when` the camera is unplugged."""

    def __init__(self, kernel: FakeKernel, when: float) -> None:
        self.kernel, self.when = kernel, when

    def monotonic(self) -> float:
        return self.kernel.now()

    def sleep(self, seconds: float) -> None:
        # images are read by a process, which lives by the wall clock
        time.sleep(seconds)
        self.kernel.wait_until(self.kernel.now() + seconds)
        if self.kernel.plugged and self.kernel.now() > self.when:
            self.kernel.unplug()


def folded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unplugged: float = float("inf")
) -> Result:
    """`cell fold` with a camera that shows nothing but noise."""
    kernel = FakeKernel(640, 360, 30.0)
    monkeypatch.setattr(drivers.v4l2.camera, "Kernel", lambda: kernel)
    monkeypatch.setattr(drivers.base.clock, "time", KernelTime(kernel, unplugged))
    # tested apart
    monkeypatch.setattr("cell.setup.arm.run_settings.refuse_failed", lambda _: None)
    configure(tmp_path, V4l2Settings(device=LINK, width=640, height=360, rate=30.0))
    words = "fold --strip denim --arm twin --camera v4l2 --policy triangular --json"
    places = f"--configs {tmp_path} --runs {tmp_path}/runs --viz off"
    done = CliRunner().invoke(app, f"{words} {places}".split())
    assert kernel.opened == set()
    assert kernel.mapped == 0
    return done


def test_picture_without_a_strip_is_refused_with_the_reasons(
    tmp_path, monkeypatch
) -> None:
    done = folded(tmp_path, monkeypatch)
    assert done.exit_code == 3
    line = json.loads(done.stdout)
    assert (line["outcome"], line["displacement_true"]) == ("preflight_refused", None)
    assert "strip lies there: seen along" in done.stderr
    assert "lay the strip along the x-axis" in done.stderr
    header = next((tmp_path / "runs").glob("*/run.yaml")).read_text()
    assert "camera_hz: 30.0" in header


def test_camera_that_is_unplugged_stops_the_run_by_name(tmp_path, monkeypatch) -> None:
    done = folded(tmp_path, monkeypatch, unplugged=0.5)
    assert done.exit_code == 4
    line = json.loads(done.stdout)
    assert line["outcome"] == "camera_lost"
    assert line["duration"] < 1.5
    assert "plug the camera in" in done.stderr
