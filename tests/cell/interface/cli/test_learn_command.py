"""`cell learn` shows what the cell has learned of its bias and of the edges that it
lays.
"""

import json
import shutil
from pathlib import Path

import pytest

from cell.folding.experience import Experience, Memory, run_key
from tests.support.commands import invoke, refused
from tests.support.refusals import refusal
from tests.support.requests import CELL
from tests.support.run_edits import edit_yaml


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Memory:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    made = Memory(CELL.name)
    for run in ("r0", "r1"):
        made.add(
            Experience(run, "adaptive", "denim", "a", "camera", 0.003, edges=-0.003)
        )
    return made


def test_it_shows_the_bias_and_where_edges_are_laid(memory: Memory) -> None:
    shown = call()
    assert "denim, a, adaptive: bias +3.0" in shown
    assert "edges laid -2." in shown
    row = json.loads(call("--json"))
    assert row["folds"] == 2
    assert row["bias"] == pytest.approx(
        row["cell"] + row["of_strip"] + row["of_specimen"]
    )
    assert row["laid"] == pytest.approx(-0.003, abs=5e-4)


def test_a_run_goes_with_a_rulers_word(memory: Memory) -> None:
    with refusal("a run goes with --edges"):
        call("runs/r0")
    with refusal("--edges: goes with a run"):
        call("show --edges 3mm")
    assert len(memory.experiences()) == 2


@pytest.fixture
def run(memory: Memory, tmp_path: Path, finished: Path, monkeypatch) -> Path:
    """A run under another name than the one that the cell learned from, as seen at +1
    mm.
    """
    monkeypatch.chdir(tmp_path)
    folder = shutil.copytree(
        finished, tmp_path / "runs/20261129T080000Z-denim-fold-2c41"
    )
    edit_yaml(folder / "result.yaml", edge_offset=0.001)
    key = run_key(folder)
    memory.add(
        Experience("r2", "adaptive", "denim", "a", "camera", 0.003, key=key, aim=-0.002)
    )
    return folder


def call(*words: object) -> str:
    done = invoke("learn", *words)
    if done.exception is not None:
        raise done.exception
    return done.output


def test_a_ruler_s_word_is_believed_within_bounds_and_a_later_one_replaces_it(
    memory: Memory, run: Path
) -> None:
    with refusal(r"34\.0 mm from the \+1\.0 .* add --sure"):
        call(run, "--edges 35mm")
    with refusal("mind sign, decimal point and unit"):
        call(run, "--edges 9mm")  # for 0.9 mm
    assert len(memory.experiences()) == 3
    call(run, "--edges 35mm --sure")
    assert "the ruler shows +2.0 mm more" in call("2c41 --edges 3mm")
    words = [one for one in memory.experiences() if one.kind == "ruler"]
    assert [(one.run, round(one.rig, 6)) for one in words] == [("r2", 0.002)]
    assert "set aside" in call("forget 2c41")


def test_the_twin_and_the_real_cell_learn_apart(memory: Memory) -> None:
    twin = Memory(CELL.name, twin=True)
    twin.add(Experience("t0", "adaptive", "denim", "a", "camera", -0.005))
    assert "t0" not in call("list")
    assert "t0" in call("list --twin")
    call("forget --twin")
    assert twin.experiences() == ()
    assert len(memory.experiences()) == 2


def test_a_misspelt_word_is_answered_once_and_with_the_right_one(
    memory: Memory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(monkeypatch, capsys, "learn shwo")
    assert line.startswith(
        "'shwo' (did you mean 'show'?) is neither show, list, forget"
    )
