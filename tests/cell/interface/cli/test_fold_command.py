"""`cell fold` as programs call it: its lines, its exit code, its refusals."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import cell.interface.api
from cell.base.config.places import CHECKOUT_CONFIGS, Configs
from cell.folding.correction import subject_of
from cell.folding.experience import Experience, Memory
from cell.folding.request import RecordingOptions, Request
from cell.folding.result import FoldResult
from drivers.base.errors import CellError, ConfigurationError
from tests.support.commands import run
from tests.support.made_results import DONE, STOPPED, fold_by
from tests.support.run_edits import edit_yaml


@pytest.fixture
def folds(
    monkeypatch, tmp_path
) -> Callable[..., tuple[int, list[dict], list[Request]]]:
    """Runs `cell fold` with folds that end as they are told; exit code, lines, what was
    folded.
    """

    def command(capsys, ends: list[FoldResult | CellError], *words: object):
        asked: list[Request] = []

        def fold(request, calibration, shown, interrupted) -> FoldResult:
            asked.append(request)
            end = ends[len(asked) - 1]
            if isinstance(end, CellError):
                raise end
            if end.exit_code == 130:
                interrupted._requested = True
            return end

        fold_by(monkeypatch, fold)
        words = ("fold --strip denim --json --runs", tmp_path / "r", *words)
        code = run(monkeypatch, *words)
        told = capsys.readouterr()
        lines = [
            json.loads(line, parse_constant=no_constant)
            for line in told.out.splitlines()
        ]
        return code, lines, told.err.splitlines(), asked

    return command


def no_constant(name: str) -> None:
    raise AssertionError(f"{name} is not JSON")


def test_a_line_holds_what_programs_agreed_on_and_no_more(folds, capsys) -> None:
    code, (line,), remarks, _ = folds(capsys, [DONE])
    assert code == 0
    assert remarks == []
    agreed = (
        "run strip policy seed outcome displacement displacement_true layer_touch"
        " edge_offset edge_offset_true like_model duration wall calibration exit_code"
        " witnesses"
    )
    assert list(line) == agreed.split()
    assert line["displacement"] == -0.033765
    assert line["displacement_true"] is None


def test_the_exit_code_is_the_largest_of_the_folds(folds, capsys) -> None:
    refused = replace(DONE, outcome="preflight_refused", displacement=None, exit_code=3)
    missed = replace(DONE, outcome="path_done", displacement=None, exit_code=1)
    code, lines, remarks, _ = folds(capsys, [missed, refused, DONE], "--repeat", 3)
    assert code == 3
    assert [line["exit_code"] for line in lines] == [1, 3, 0]
    assert len(remarks) == 3
    assert "2 of 3 are done and kept; the same command with --resume" in remarks[-1]


def test_a_fold_that_cannot_begin_ends_no_batch(folds, capsys) -> None:
    stopped = replace(DONE, outcome="force", exit_code=4)
    ends = [stopped, ConfigurationError("runs: cannot be written"), DONE]
    code, lines, remarks, asked = folds(capsys, ends, "--repeat", 3)
    assert code == 4
    assert [line["outcome"] for line in lines] == ["force", "error", DONE.outcome]
    assert [line["exit_code"] for line in lines] == [4, 2, 0]
    assert (lines[1]["run"], lines[1]["seed"]) == (None, 1)
    assert "cell: error: runs: cannot be written" in remarks
    assert len(asked) == 3


def test_ctrl_c_ends_the_whole_batch(folds, capsys) -> None:
    code, lines, _, asked = folds(capsys, [STOPPED, DONE, DONE], "--repeat", 3)
    assert code == 130
    assert [line["outcome"] for line in lines] == ["interrupted"]
    assert len(asked) == 1


@pytest.fixture
def broken_plant(tmp_path) -> Path:
    path = tmp_path / "broken.yaml"
    path.write_text("schema: 1\nname: broken\n")
    return path


def test_a_plant_that_cannot_be_used_is_refused_before_the_first_fold(
    folds, capsys, broken_plant, tmp_path
) -> None:
    good = CHECKOUT_CONFIGS / "strips/denim.yaml"
    plants = ("--plant", good, "--plant", broken_plant)
    code, lines, remarks, asked = folds(capsys, [DONE, DONE], *plants)
    assert code == 2
    assert asked == []
    assert lines == []
    assert remarks[0].startswith(f"cell: {broken_plant}")
    os.mkfifo(tmp_path / "pipe.yaml")
    for name in ("missing.yaml", "pipe.yaml"):
        assert folds(capsys, [], "--plant", tmp_path / name, "--dry-run")[0] == 2


def test_a_defect_of_the_program_is_one_line_and_no_traceback(
    monkeypatch, capsys, tmp_path
) -> None:
    def defect(*_: object, **__: object) -> None:
        raise ZeroDivisionError("nobody foresaw this")

    monkeypatch.setattr("cell.record.listing.list_runs", defect)
    assert run(monkeypatch, "runs --runs", tmp_path) == 1
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert "ZeroDivisionError in test_fold_command.py" in told.err
    assert "nobody foresaw this" in told.err


def test_python_and_command_ask_for_one_fold_with_what_the_cell_has_learned(
    monkeypatch, folds, capsys, tmp_path, configs
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    edit_yaml(configs / "cell.yaml", learning={"use": "on"})
    twin = Memory(Configs(configs).cell().name, twin=True)
    policy = subject_of("adaptive", None, "denim", None).policy
    for number in range(3):
        taught = {"displacement": 0.004, "edges": 0.002, "key": f"{number}"}
        twin.add(Experience(f"r{number}", policy, "denim", "denim", "camera", **taught))

    *_, (typed,) = folds(capsys, [DONE], "--configs", configs, "--film", "none")
    asked = []
    monkeypatch.setattr(
        cell.interface.api, "fold_once", lambda request, _: asked.append(request)
    )
    cell.interface.api.fold("denim", runs=tmp_path / "r", configs=configs)
    assert typed.learning.learns
    assert typed.learning.correction.seen > 0.002
    assert replace(typed, record=RecordingOptions()) == replace(
        asked[0], record=RecordingOptions()
    )


def test_until_without_a_series_is_refused_and_teaches_nothing(
    monkeypatch, capsys, folds
) -> None:
    code, _, remarks, asked = folds(capsys, [DONE], "--until", "1mm")
    assert code == 2
    assert asked == []
    assert "--until: ends a series" in remarks[0]
    assert "--repeat" in remarks[0]


def test_second_line_of_one_fold_is_refused_with_the_reason(folds, capsys) -> None:
    code, _, remarks, asked = folds(capsys, [DONE], "--at", "1/3", "--at", "1/3")
    assert code == 2
    assert asked == []
    assert "a second fold carries two layers" in remarks[0]
