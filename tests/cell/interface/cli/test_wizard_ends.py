"""What a wizard reports when the operator stops it, or when another one is at work."""

from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace

import pytest

from cell.orchestrator.operator import Interrupted
from cell.setup.wizard import Wizard
from cell.setup.wizard_panel import wizard_at_terminal
from tests.support.refusals import refusal


def at_terminal(folder: Path) -> AbstractContextManager[Wizard]:
    devices = SimpleNamespace(aids=None)
    return wizard_at_terminal(
        None, devices, interactive=True, session=(folder, "camera")
    )


@pytest.mark.parametrize(
    "stop", [KeyboardInterrupt, Interrupted], ids=["twice", "once"]
)
def test_stopped_wizard_names_the_folder_that_keeps_its_images(
    stop, tmp_path: Path
) -> None:
    rows = [
        '{"number": 1, "image": "images/0000.png"}',
        '{"number": 2, "refused": "too dark"}',
    ]
    (tmp_path / "told.jsonl").write_text("\n".join(rows) + "\n")
    with (
        pytest.raises(Interrupted, match="1 image kept in") as ended,
        at_terminal(tmp_path),
    ):
        raise stop
    assert f"`cell calibrate camera --from {tmp_path}` solves them" in str(ended.value)
    assert f"`cell calibrate camera --resume {tmp_path}` goes on" in str(ended.value)
    assert ended.value.exit_code == 130


def test_wizard_stopped_before_its_first_image_says_that_nothing_was_taken(
    tmp_path: Path,
) -> None:
    with (
        pytest.raises(Interrupted, match="nothing was taken yet"),
        at_terminal(tmp_path),
    ):
        raise KeyboardInterrupt


def test_second_wizard_in_the_folder_of_another_is_refused(
    monkeypatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("drivers.base.files.LOCK_TIMEOUT", 0.05)
    with (
        at_terminal(tmp_path),
        refusal("another command"),
    ):
        at_terminal(tmp_path).__enter__()
