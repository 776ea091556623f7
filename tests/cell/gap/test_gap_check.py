"""What is wrong with recordings is said before anything is fitted to them."""

import json
from pathlib import Path

import numpy as np
import pytest

from cell.gap.check import check, recordings, unidentifiable
from cell.gap.fit import fit
from cell.gap.subject.run_folders import RunFolder, find_runs
from cell.gap.subject.run_table import clock, values
from drivers.base.errors import ConfigurationError
from tests.support.commands import run
from tests.support.curves import Curves, nothing
from tests.support.gap_strip_cases import STRIP, folds, written
from tests.support.mechanisms import PRESCRIBED, make_arm
from tests.support.run_edits import edit_column

T = np.arange(0.0, 4.0, 0.01)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    written(tmp_path / "runs", folds(["normal", "fast"]))
    return tmp_path / "runs"


@pytest.mark.parametrize(
    ("kept", "levels"),
    [
        (slice(None), []),
        (np.r_[0:200, 230:400], ["fair"]),
        (np.r_[0:100, 300:400], ["bad"]),
    ],
)
def test_lost_rows_are_counted(kept: slice, levels: list[str]) -> None:
    assert [c.level for c in clock(T[kept])] == levels


def test_a_reading_that_stands_still_while_its_command_moves_is_stuck() -> None:
    x = 0.5 * T
    x[100:150] = x[100]
    assert [c.what for c in values("x", T, x, 0.5 * T)] == ["stuck reading"]
    assert not [*values("x", T, x, 0.0 * T), *values("x", T, x)]


def test_a_reading_that_is_cut_off_is_said_and_one_that_rests_is_not() -> None:
    wave = np.sin(6.0 * T)
    assert [c.what for c in values("a", T, np.minimum(wave, 0.8))] == ["saturation"]
    rests = np.clip(wave, -0.8, 0.8)
    ramp = np.clip(T - 1.0, 0.0, 2.0)
    for args in ((wave,), (ramp,), (rests, rests)):
        assert not [*values("a", T, *args)]


def test_runs_of_the_cell_are_in_order(runs: Path) -> None:
    assert not recordings(find_runs([runs]))
    assert not recordings([RunFolder(runs / "nowhere", "nowhere")])


@pytest.mark.slow
def test_a_fit_refuses_a_stuck_reading_unless_asked(
    runs: Path, tmp_path, monkeypatch, capsys
) -> None:
    ticks = runs / "00-normal" / "ticks.parquet"
    edit_column(
        ticks, "x", lambda x: x[np.r_[:120, [120] * 80, 120:280:2, 280 : len(x)]]
    )
    edit_column(ticks, "x_cmd", lambda x: np.linspace(0.6, 0.0, len(x)))
    stuck, out = r"00-normal: stuck reading: .*; mend the reading", tmp_path / "out"
    with pytest.raises(ConfigurationError, match=stuck):
        fit([runs], STRIP, out)
    assert not out.exists()
    (tmp_path / "denim").mkdir()  # where the command is called: no strip
    monkeypatch.chdir(tmp_path)
    words = ("gap check", runs, "--strip denim --json --out", out)
    assert run(monkeypatch, *words) == ConfigurationError.exit_code
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "check.json").read_text())
    bad = [f["what"] for f in printed["findings"] if f["level"] == "bad"]
    assert bad == ["stuck reading"]
    assert "mend the reading" in (out / "check.html").read_text()


@pytest.mark.slow
def test_a_check_says_what_cannot_be_read(runs: Path) -> None:
    edit_column(runs / "00-normal" / "ticks.parquet", "t", lambda t: t[::-1])
    broken = check([runs], STRIP)
    assert broken.level == "bad"
    assert [f.what for f in broken.findings if f.level == "bad"] == ["unreadable"]


def test_what_runs_cannot_say_is_listed_with_the_size_that_was_tried(
    tmp_path: Path,
) -> None:
    curves = Curves(nothing, names=("bump", "twin", "dead"))
    assert [found.words for found in unidentifiable(curves)] == [
        "dead: size 0.1 m changes the runs by only 0.0 sigma",
        "bump and twin change these runs alike: they cannot be separated",
    ]
    file, made = make_arm(tmp_path, content=PRESCRIBED)
    arm = check([made], file).findings
    assert "base_tilt" not in str(arm)  # though about x it shows nothing
    assert {f.remedy for f in arm if f.what == "run"} == {""}
