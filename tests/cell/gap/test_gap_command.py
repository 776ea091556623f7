"""`cell gap` on the command line: fit, accept, undo, advise."""

import json
from pathlib import Path

import pytest

from tests.support.commands import refused, run

SINGLE = Path(__file__).resolve().parents[4] / "shared" / "data" / "pendulum" / "single"


def test_missing_runs_are_refused_and_leave_nothing_of_an_earlier_fit(
    monkeypatch, capsys, tmp_path
) -> None:
    strip, out = Path("configs/strips/denim.yaml").resolve(), tmp_path / "out"
    out.mkdir()
    for name in ("verdict.json", "report.html", "fit.json", "overlay.rrd"):
        (out / name).write_text("earlier")
    line = refused(
        monkeypatch, capsys, "gap", "fit", tmp_path / "none", "--strip", strip, "--out", out
    )
    assert str(tmp_path / "none") in line
    assert not list(out.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not SINGLE.is_dir(), reason="the measured pendulums are absent")
def test_a_fit_prints_the_verdict_that_it_wrote(monkeypatch, capsys, tmp_path) -> None:
    runs = [SINGLE / "runs" / f"{k:02d}" for k in range(4)]
    words = ["gap", "fit", *runs, "--strip", SINGLE / "pendulum.yaml"]
    assert run(monkeypatch, *words, "--out", tmp_path, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "verdict.json").read_text())
    assert {"report.html", "overlay.rrd"} <= {path.name for path in tmp_path.iterdir()}
