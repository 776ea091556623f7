"""A calibration in Rerun: what is wanted and why, what is covered, what was refused and touched."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from calibration.wizard.coverage import Gate, Sketch
from calibration.wizard.news import Mark, MarkKind, News, Result, Row
from cell.report.viz.wizard import WIZARD_RECORDING, wizard_screen
from drivers.types import Frame

FRAME = Frame(0.0, 0.0, "test", 0, np.full((72, 128, 3), 90, np.uint8))
GATES = (Gate("x", 0.2, 0.5, "", "show it far left and far right"),)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """All that was drawn, by entity, as text."""
    folder: Path = tmp_path_factory.mktemp("session")
    kinds = (MarkKind.FITTED, MarkKind.FITTED, MarkKind.HELD_OUT)
    touched = tuple(Mark(np.array([10.0 * k, 20.0]), kind, str(k)) for k, kind in enumerate(kinds))
    refused = Result(Row(number=4, refused="0 corners of the board are seen"))
    answer = refused.text("image", "taken")
    with wizard_screen(folder) as screen:
        ghost = np.array([(10.0, 10), (33.5, 10), (30, 30), (10, 30)])
        news = News("the lens", "show the board low", "still missing: x", FRAME, refused, answer)
        screen(replace(news, coverage=GATES, sketch=Sketch((128, 72), ghost, None)))
        screen(News("the map", "the arm goes to x 368, z 15 mm", "once more", marks=touched))
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
    assert "next: show the board low" in words
    assert "why: still missing: x" in words
    assert "the arm goes to x 368, z 15 mm" in words
    assert "good: this calibration may be used" in words


def test_refusals_stand_in_the_log(recorded) -> None:
    assert "image 4: 0 corners of the board are seen" in recorded["/wizard/log"]


def test_image_coverage_and_touched_points_are_drawn(recorded) -> None:
    assert "/camera/image" in recorded
    assert "0.4" in recorded["/wizard/coverage"]
    assert "20.0" in recorded["/camera/image/marks"]


def test_wanted_board_is_drawn_into_the_image(recorded) -> None:
    assert "33.5" in recorded["/camera/image/wanted"]
    assert "'wanted'" in recorded["/camera/image/wanted"]
