"""`cell learn` shows what the cell has learned of its bias and of the edges that it lays."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cell.cli.app import app
from cell.config.places import find_configs
from cell.learning.experience import Experience, Memory
from drivers.errors import ConfigurationError
from tests.cell.cli.test_command_errors import refused


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Memory:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    made = Memory(find_configs(None).cell().name)
    for run in ("r0", "r1"):
        made.add(Experience(run, "adaptive", "denim", "a", "camera", 0.003, edges=-0.003))
    return made


def test_it_shows_the_bias_and_where_edges_are_laid(memory: Memory) -> None:
    shown = CliRunner().invoke(app, ["learn"])
    assert shown.exit_code == 0
    assert "denim, a, adaptive: bias +3.0" in shown.output
    assert "edges laid -2." in shown.output
    (line,) = CliRunner().invoke(app, ["learn", "--json"]).output.splitlines()
    row = json.loads(line)
    assert row["folds"] == 2
    assert row["bias"] == pytest.approx(row["cell"] + row["of_strip"] + row["of_specimen"])
    assert row["laid"] == pytest.approx(-0.003, abs=5e-4)


def test_a_run_goes_with_a_rulers_word(memory: Memory) -> None:
    for wrong in (["learn", "runs/r0"], ["learn", "show", "--edges", "3mm"]):
        refused = CliRunner().invoke(app, wrong)
        assert isinstance(refused.exception, ConfigurationError)
    assert len(memory.experiences()) == 2


def test_a_misspelt_word_is_answered_once_and_with_the_right_one(
    memory: Memory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(monkeypatch, capsys, "learn", "shwo")
    assert line.startswith("'shwo' (did you mean 'show'?) is neither show, forget")
