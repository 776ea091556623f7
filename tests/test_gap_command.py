"""`cell gap` on the command line: fit, accept, undo, advise."""

import json
import os
from pathlib import Path

import pytest

from cell.__main__ import main
from tests.test_command_errors import refused

SINGLE = Path(__file__).resolve().parents[2] / "shared" / "data" / "pendulum" / "single"


def test_missing_runs_are_refused_and_leave_no_verdict(monkeypatch, capsys, tmp_path) -> None:
    strip = Path("configs/strips/denim.yaml").resolve()
    words = ("gap", "fit", tmp_path / "none", "--strip", strip, "--out", tmp_path / "out")
    line = refused(monkeypatch, capsys, *words)
    assert str(tmp_path / "none") in line
    assert not (tmp_path / "out" / "verdict.json").exists()


@pytest.mark.parametrize("command", ["accept", "undo"])
def test_a_folder_without_a_fit_is_refused(monkeypatch, capsys, tmp_path, command) -> None:
    strip = Path("configs/strips/denim.yaml").resolve()
    line = refused(monkeypatch, capsys, "gap", command, tmp_path, "--strip", strip)
    assert str(tmp_path) in line


@pytest.mark.skipif(not SINGLE.is_dir(), reason="the measured pendulums are absent")
def test_a_fit_prints_the_verdict_that_it_wrote(monkeypatch, capsys, tmp_path) -> None:
    words = ["gap", "fit", SINGLE / "runs", "--strip", SINGLE / "pendulum.yaml"]
    monkeypatch.setattr(
        "sys.argv", ["cell", *map(os.fspath, words), "--out", str(tmp_path), "--json"]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "verdict.json").read_text())
    assert (tmp_path / "report.html").exists()
