"""What a wizard reports when the operator stops it."""

from pathlib import Path

import pytest

from cell.calibrate.wizard_panel import wizard_session
from cell.orchestrator.operator import Interrupted


@pytest.mark.parametrize("stop", [KeyboardInterrupt, Interrupted], ids=["twice", "once"])
def test_stopped_wizard_names_the_folder_that_keeps_its_images(stop, tmp_path: Path) -> None:
    rows = ['{"number": 1, "image": "images/0000.png"}', '{"number": 2, "refused": "too dark"}']
    (tmp_path / "told.jsonl").write_text("\n".join(rows) + "\n")
    with (
        pytest.raises(Interrupted, match="1 image kept in") as ended,
        wizard_session(tmp_path, "camera", "off"),
    ):
        raise stop
    assert f"`cell calibrate camera --from {tmp_path}` solves them" in str(ended.value)
    assert f"`cell calibrate camera --resume {tmp_path}` goes on" in str(ended.value)
    assert ended.value.exit_code == 130


def test_wizard_stopped_before_its_first_image_says_that_nothing_was_taken(tmp_path: Path) -> None:
    with (
        pytest.raises(Interrupted, match="nothing was taken yet"),
        wizard_session(tmp_path, "homography", "off"),
    ):
        raise KeyboardInterrupt
