"""Series of folds that stop: what is done stays, and --resume goes on with the rest."""

import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from cell.folding.batch import Callbacks, fold_all
from cell.folding.request import Request
from cell.folding.result import FoldResult
from cell.folding.series import series_of
from cell.record.files import MANIFEST
from cell.record.manifest import Manifest, manifests_in
from tests.cell.folding.test_batch import fake, repeated  # noqa: F401  a fixture
from tests.support.commands import invoke
from tests.support.dying import no_room
from tests.support.made_results import DONE, STOPPED, fold_by
from tests.support.refusals import refusal

PLAN = "gap plan --strip denim --runs"
BATCH = "fold --strip denim --repeat 4 --json --runs"


@pytest.fixture
def folds(monkeypatch: pytest.MonkeyPatch) -> "Folds":
    made = Folds()
    fold_by(monkeypatch, made)
    return made


class Folds:
    """Folds that end as `ends` says by their number since the last look; all others are
    done.
    """

    def __init__(self) -> None:
        self.ends: dict[int, FoldResult] = {}
        self.trials: list[tuple[int, int]] = []

    def __call__(self, request: Request, *_: object) -> FoldResult:
        seed = request.trial.seed
        number = len(self.trials)
        self.trials.append((request.trial.index, seed))
        request.runs.mkdir(parents=True, exist_ok=True)
        end = self.ends.get(number, DONE)
        if isinstance(end, type):
            raise end
        return replace(end, run=str(request.runs / str(seed)))

    def look(self) -> list[tuple[int, int]]:
        seen, self.trials, self.ends = self.trials, [], {}
        return seen


FAULT = replace(DONE, outcome="camera_stale", exit_code=4, displacement=None)


def test_plan_goes_on_and_lays_again_what_a_fault_ended(
    tmp_path: Path, folds: Folds
) -> None:
    folds.ends = {2: FAULT, 6: STOPPED}

    def stop_at_seven(request: Request, *rest: object) -> FoldResult:
        if len(folds.trials) == 7:
            raise KeyboardInterrupt
        return folds(request, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cell.folding.batch.fold", stop_at_seven)
        stopped = invoke(PLAN, tmp_path / "plan")
    assert stopped.exit_code == 130
    assert "5 of 11 are done and kept; the same command with --resume" in stopped.output
    assert [index for index, _ in folds.look()] == list(range(7))

    refused = invoke(PLAN, tmp_path / "plan")
    assert "5 of 11 done; go on with --resume" in str(refused.exception)
    assert folds.look() == []

    resumed = invoke(PLAN, tmp_path / "plan", "--resume")
    assert resumed.exit_code == 0, resumed.output
    assert "number 2 is laid again: camera_stale" in resumed.stderr
    assert "number 7 is laid again: its process ended" in resumed.stderr
    again = [(11, 11), (12, 12), (13, 13)]
    assert folds.look() == [(8, 8), (9, 9), (10, 10), *again]
    assert "next: cell gap fit" in resumed.stdout
    assert Manifest.read(tmp_path / "plan" / MANIFEST).is_complete


def test_batch_goes_on_with_the_newest_that_is_not_complete(
    tmp_path: Path, folds: Folds
) -> None:
    folds.ends = {1: FAULT}
    assert invoke(BATCH, tmp_path).exit_code == 4
    assert len(folds.look()) == 4
    resumed = invoke(BATCH, tmp_path, "--resume")
    assert resumed.exit_code == 0
    assert [json.loads(line)["run"] for line in resumed.stdout.splitlines()] == [
        str(tmp_path / "4")
    ]
    assert folds.look() == [(4, 4)]
    over = invoke(BATCH, tmp_path, "--resume")
    assert "no unfinished batch in" in str(over.exception)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ("--seed 5", "not as when this batch began: plan;"),
        ("--policy planned", "began: plan;"),
        ("--at 1/3", "began: plan;"),
        ("--plant denim", "began: plant;"),
        ("--strip swimwear", "began: strip;"),
    ],
)
def test_another_series_is_not_resumed(
    tmp_path: Path, folds: Folds, changed: str, says: str
) -> None:
    folds.ends = {1: FAULT}
    invoke(BATCH, tmp_path)
    folds.look()
    refused = invoke(BATCH, tmp_path, changed, "--resume")
    assert says in str(refused.exception)
    assert folds.look() == []


def test_series_until_edges_are_close_is_over_with_them(
    tmp_path: Path, folds: Folds
) -> None:
    folds.ends = {1: replace(DONE, edge_offset=0.0005)}
    assert invoke(BATCH, tmp_path, "--until 1mm").exit_code == 0
    assert len(folds.look()) == 2
    assert [each.is_complete for each in manifests_in(tmp_path)] == [True]


def test_single_fold_has_no_manifest_and_nothing_to_resume(
    tmp_path: Path, folds: Folds
) -> None:
    one = ("fold --strip denim --runs", tmp_path)
    assert invoke(*one).exit_code == 0
    assert manifests_in(tmp_path) == ()
    assert "goes with --repeat" in str(invoke(*one, "--resume").exception)


def test_second_shell_is_told_what_is_under_way(tmp_path: Path, folds: Folds) -> None:
    words: list[str] = []

    def ask_elsewhere(request: Request, *rest: object) -> FoldResult:
        if len(folds.trials) == 1:
            plan = (PLAN, tmp_path / "plan")
            words.append(str(invoke(*plan).exception))
            words.append(str(invoke(*plan, "--resume").exception))
            words.append(invoke("runs --runs", tmp_path).stderr)
        return folds(request, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cell.folding.batch.fold", ask_elsewhere)
        invoke(PLAN, tmp_path / "plan")
    said = f"plan of denim in {tmp_path / 'plan'}: 1 of 11 done, under way (process "
    assert [said in word for word in words] == [True] * 3
    assert ["wait for it" in word for word in words] == [True, True, False]


def test_results_of_parallel_folds_are_kept_as_they_end(
    fake,  # noqa: F811
    tmp_path: Path,
) -> None:
    fake.ends = [1]
    requests = repeated(tmp_path, 3)
    with series_of(requests, "batch") as remainder:
        path = remainder.series.manifest.path
        attended = Callbacks(
            interrupt=lambda: nullcontext(lambda: 1 in Manifest.read(path).done),
            begin=remainder.begin,
            end=remainder.end,
        )
        list(fold_all(requests, 2, None, attended))
        assert Manifest.read(path).done == {1}
        assert Manifest.read(path).begun[:2] == (0, 1)


@pytest.mark.parametrize("text", ["", "{}\n", '{"kind": "plan"}\n', "\0\n"])
def test_broken_manifest_is_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / MANIFEST
    path.write_text(text)
    with refusal("is no manifest of a series"):
        Manifest.read(path)
    assert manifests_in(tmp_path) == ()


def test_fold_does_not_begin_where_its_manifest_cannot_be_written(
    tmp_path: Path, folds: Folds, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cell.record.manifest.append_line", no_room)
    result = invoke(BATCH, tmp_path)
    assert result.exit_code == 2
    assert "make room, then go on with --resume" in result.stderr
    assert folds.look() == []
