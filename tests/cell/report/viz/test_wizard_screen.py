"""A calibration in Rerun: what is wanted and why, what is covered, what was refused and touched."""

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from calibration.wizard.coverage import Gate, Sketch, WantedView
from calibration.wizard.news import Result, Stage, TouchNews, ViewNews
from calibration.wizard.touches import Touched, TouchSettings, touch_plan
from cell.report.viz.wizard import WIZARD_RECORDING, wizard_screen
from drivers.types import Frame

FRAME = Frame(0.0, 0.0, "test", 0, np.full((72, 128, 3), 90, np.uint8))
GATES = (Gate("x", 0.2, 0.5, "", "show it far left and far right"),)
PLAN = touch_plan(TouchSettings())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """All that was drawn, by entity, as text."""
    folder: Path = tmp_path_factory.mktemp("session")
    touched = tuple(
        Touched(k, np.zeros(2), np.array([10.0 * k, 20.0]), held_out=k == 2) for k in range(3)
    )
    refused = Result(4, None, None, "0 corners of the board are seen")
    with wizard_screen(folder) as screen:
        ghost = np.array([(10.0, 10), (33.5, 10), (30, 30), (10, 30)])
        wanted = WantedView(0.2, 0.3, 0.4)
        sketch = Sketch((128, 72), ghost, None)
        screen(ViewNews(wanted, "still missing: x", GATES, FRAME, refused, sketch))
        screen(TouchNews(Stage.AGAIN, PLAN, touched, PLAN[3], "touch it once more"))
        screen.verdict("good: this calibration may be used")
    found: dict[str, str] = {}
    for chunk in RrdReader(folder / WIZARD_RECORDING).stream().to_chunks():
        batch = chunk.to_record_batch()
        drawn = [name for name in batch.schema.names if ":" in name]
        said = " ".join(str(batch[name].to_pylist()) for name in drawn)
        found[chunk.entity_path] = found.get(chunk.entity_path, "") + said
    return found


def test_request_and_its_reason_are_shown(recorded) -> None:
    words = recorded["/wizard/words"]
    assert "next: high and left, 40 % of the image wide, facing the camera" in words
    assert "why: still missing: x" in words
    assert "the arm goes to x 368, z 15 mm" in words
    assert "good: this calibration may be used" in words


def test_refusals_stand_in_the_log(recorded) -> None:
    assert "image 4: 0 corners of the board are seen" in recorded["/wizard/log"]


def test_image_coverage_and_touched_points_are_drawn(recorded) -> None:
    assert "/camera/image" in recorded
    assert "0.4" in recorded["/wizard/coverage"]
    assert "20.0" in recorded["/camera/image/touched"]


def test_wanted_board_is_drawn_into_the_image(recorded) -> None:
    assert "33.5" in recorded["/camera/image/wanted"]
    assert "'wanted'" in recorded["/camera/image/wanted"]
