"""`cell calibrate` and its wizards at the command line: refusals in a line, exit codes,
JSON.
"""

import json
import os
from pathlib import Path

import pytest

from calibration.board import BoardSettings
from calibration.lens import CameraFile
from calibration.wizard.progress import SessionRow
from calibration.wizard.session import SessionFile, SessionFolder
from calibration.wizard.touches import TouchSettings, touch_plan
from cell.base.config.places import CHECKOUT_CONFIGS
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.commands import refused, run
from tests.support.twin_calibration import NO_STRIP, pointer_frame, true_lens

CONFIGS = ("--configs", CHECKOUT_CONFIGS)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A kept session of twenty-four touches and no steps, through rendered images."""
    folder = tmp_path_factory.mktemp("kept") / "homography"
    facts = {
        "date": "2026-11-20T03:15:00+00:00",
        "camera": "kept",
        "image": (1280, 720),
    }
    lens = CameraFile.from_lens(true_lens(), "kept")
    keep = SessionFolder(
        folder, SessionFile(schema=1, kind="homography", lens=lens, **facts)
    )
    renderer = Renderer(CameraSettings(), NO_STRIP, 0)
    for number, pose in enumerate(touch_plan(TouchSettings())):
        row = SessionRow(number=number, pose=(pose.x, pose.z, pose.pitch))
        keep.add(row, pointer_frame(renderer, pose, number).image)
    return folder


def test_board_is_printed_with_what_to_measure(monkeypatch, capsys, tmp_path) -> None:
    path = tmp_path / "board.pdf"
    assert run(monkeypatch, "calibrate camera --print", path, *CONFIGS) == 0
    width = 1e3 * BoardSettings().width
    assert f"all 9 squares must measure {width:.1f} mm" in capsys.readouterr().out
    assert path.read_bytes().startswith(b"%PDF")


def test_homography_without_a_lens_says_what_to_run_first(
    monkeypatch, capsys, tmp_path
) -> None:
    monkeypatch.chdir(tmp_path)
    line = refused(monkeypatch, capsys, "calibrate homography", *CONFIGS)
    assert "run `cell calibrate camera` first" in line
    assert list(tmp_path.iterdir()) == []


def test_pipe_in_the_place_of_a_lens_is_refused_and_never_opened(
    monkeypatch, capsys, tmp_path
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "calibrations" / "one").mkdir(parents=True)
    os.mkfifo(tmp_path / "calibrations" / "one" / "camera_info.yaml")
    line = refused(monkeypatch, capsys, "calibrate homography", *CONFIGS)
    assert "camera_info.yaml: cannot be read: is a pipe, must be a regular file" in line


@pytest.mark.parametrize("kind", ["camera", "homography"])
def test_folder_that_is_no_session_is_refused(
    monkeypatch, capsys, tmp_path, kind
) -> None:
    line = refused(monkeypatch, capsys, "calibrate", kind, "--from", tmp_path, *CONFIGS)
    assert "session.yaml: cannot be read" in line


def test_refused_session_ends_with_one_and_its_reasons(
    monkeypatch, capsys, session
) -> None:
    words = ("calibrate homography --from", session, "--json", *CONFIGS)
    assert run(monkeypatch, *words) == 1
    line = json.loads(capsys.readouterr().out)
    assert line["accepted"] is False
    assert line["reasons"] == ["the latency was not measured"]
    assert line["worst_mm"] < 0.1


def test_override_is_accepted_aloud(monkeypatch, capsys, session, tmp_path) -> None:
    words = ("calibrate homography --from", session, "--accept-anyway", *CONFIGS)
    assert run(monkeypatch, *words, "--out", tmp_path / "new", "--without 4") == 0
    said = capsys.readouterr().out
    assert "the latency was not measured" in said
    assert "accepted in spite of this; every run will say so" in said
    assert f"calibration: {tmp_path / 'new' / 'calibration.yaml'}" in said
