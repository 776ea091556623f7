import json
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml

from cell.record.listing import list_runs, remove, to_prune
from cell.record.writer import RunWriter
from tests.cell.conftest import HEADER
from tests.support.commands import invoke
from tests.support.refusals import refusal

NOW = datetime(2026, 11, 20, 12, 0, 0, tzinfo=UTC)


def lay(
    root: Path, days_ago: int, result: dict | None = None, header: str | None = None
) -> Path:
    moment = (NOW - timedelta(days=days_ago)).strftime("%Y%m%dT%H%M%SZ")
    folder = root / f"{moment}-denim-fold-{days_ago:04x}"
    folder.mkdir(parents=True)
    (folder / "run.yaml").write_text(header or yaml.safe_dump({"schema": 1, **HEADER}))
    (folder / "events.jsonl").write_text("{}\n")
    if result is not None:
        (folder / "result.yaml").write_text(yaml.safe_dump(result))
    return folder


@pytest.fixture
def four(tmp_path):
    lay(tmp_path, 1, {"outcome": "path_done", "duration": 9.0, "displacement": None})
    lay(
        tmp_path,
        2,
        {"outcome": "layer_touch", "displacement": -0.0363, "duration": 9.4},
    )
    lay(tmp_path, 30)
    lay(tmp_path, 3, {"outcome": "stale_image"}, header="strip: [")
    (tmp_path / "notes").mkdir()
    return tmp_path


def test_runs_are_listed_oldest_first_with_what_they_came_to(four):
    lay(four, 0, header="schema: 1\nmechanism: arm\n")
    rows = list_runs(four)
    assert (
        " ".join(row.outcome for row in rows)
        == "died broken layer_touch path_done measured"
    )
    touched = rows[2]
    assert (touched.strip, touched.policy, touched.duration) == (
        "denim",
        "triangular",
        9.4,
    )
    assert touched.displacement == -0.0363
    assert touched.size == sum(p.stat().st_size for p in touched.folder.iterdir())
    assert touched.began == NOW - timedelta(days=2)


@pytest.mark.parametrize(
    ("keep", "days", "gone"),
    [
        (4, None, []),
        (1, None, [30, 3, 2]),
        (0, None, [30, 3, 2, 1]),
        (None, 2.5, [30, 3]),
        (2, 10, [30]),
        (3, 0.5, [30]),
        (9, None, []),
    ],
)
def test_prune_names_the_oldest_runs(four, keep, days, gone):
    older_than = None if days is None else timedelta(days=days)
    rows = to_prune(list_runs(four), NOW, keep=keep, older_than=older_than)
    assert [(NOW - row.began).days for row in rows] == gone


def test_choosing_deletes_nothing_and_removing_deletes_just_the_chosen(four):
    chosen = to_prune(list_runs(four), NOW, keep=2)
    assert len(list_runs(four)) == 4
    assert remove(chosen) == sum(row.size for row in chosen)
    assert [row.outcome for row in list_runs(four)] == ["layer_touch", "path_done"]
    assert (four / "notes").is_dir()


def test_runs_in_folders_of_the_folder_are_listed_and_never_pruned(four):
    planned = lay(four / "plan", 0, {"outcome": "path_done"})
    assert planned in [row.folder for row in list_runs(four)]
    assert invoke(f"runs --runs {four} --keep 0 --delete").exit_code == 0
    assert [row.folder for row in list_runs(four)] == [planned]


def test_run_under_way_is_neither_chosen_nor_removed(tmp_path):
    writer = RunWriter(tmp_path, HEADER, "none")
    rows = list_runs(tmp_path)
    assert [row.outcome for row in rows] == ["under way"]
    assert to_prune(rows, NOW, keep=0) == ()
    with refusal("left alone"):
        remove(rows)
    writer.close()
    assert writer.folder.is_dir()


@pytest.fixture
def thirty(tmp_path):
    for number in range(30):
        outcome = "layer_touch" if number % 5 else "overspeed"
        folder = tmp_path / f"20261120T0000{number:02d}Z-denim-fold-{number:04x}"
        folder.mkdir()
        (folder / "run.yaml").write_text(
            f"schema: 1\nstrip: s{number % 3}\nseed: {number}\n"
        )
        (folder / "result.yaml").write_text(
            f"outcome: {outcome}\ndisplacement: {number}e-4\nedge_offset:"
            f" {-number * 1e-5}\n"
        )
    return tmp_path


@pytest.mark.parametrize(
    ("where", "sort", "seeds"),
    [("outcome = 'layer_touch' and abs(displacement) > 0.002", "-edge_offset",
      [21, 22, 23, 24, 26, 27, 28, 29]),
     ("seed between 3 and 5 or seed in (7, 9)", "-seed", [9, 7, 5, 4, 3]),
     ("not strip like 's%' or note is null or seed < 2  -- a remark", "", [0, 1]),
     ("predicted is not null", "", []), ("strip", "-began", [])],
)  # fmt: skip
def test_runs_are_filtered_and_sorted(thirty, where, sort, seeds):
    assert [row.seed for row in list_runs(thirty, where, sort)] == seeds


@pytest.mark.parametrize(
    "where",
    [
        "1); DELETE FROM runs; --",
        "nothing = 1",
        "(",
        "load_extension('x')",
        "seed = \0",
    ],
)
def test_filter_that_is_no_expression_is_refused_with_the_columns(thirty, where):
    with refusal(r"where: .*columns of runs: run, began, strip"):
        list_runs(thirty, where)
    assert len(list_runs(thirty)) == 30


def test_command_lists_as_table_csv_and_json(thirty, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    some = f"runs --runs {thirty} --where 'seed < 3'"
    table = invoke(some).stdout
    assert "edge mm" in table
    assert "-0.0" in table
    printed = invoke(some, "--json").stdout
    lines = [json.loads(line) for line in printed.splitlines()]
    assert [line["edge_offset"] for line in lines] == [0.0, -1e-5, -2e-5]
    content = invoke(some, "--csv").stdout.splitlines()
    assert content[0].startswith(
        "run,began,strip,policy,outcome,displacement,edge_offset"
    )
    assert len(content) == 4


def test_run_that_changed_since_it_was_chosen_is_not_deleted(thirty):
    chosen = to_prune(list_runs(thirty), NOW, keep=28)
    (chosen[0].folder / "notes.yaml").write_text("schema: 1\ntags: keep\n")
    with refusal("has just been changed; it was left alone"):
        remove(chosen)
    assert [row.folder.exists() for row in chosen] == [True, False]


def test_one_bad_run_does_not_spoil_the_list(thirty):
    digits, no_text = (
        Path(os.fsdecode(os.fsencode(thirty) + name)) for name in (b"/a", b"/\xff&")
    )
    for folder, seed in ((digits, "9" * 20), (no_text, "1")):
        folder.mkdir()
        (folder / "run.yaml").write_text(f"schema: 1\nstrip: felt\nseed: {seed}\n")
    (no_text / "report.html").touch()
    first = min(thirty.glob("2*"))
    (first / "run.yaml").write_text("strip: " + "[" * 100_000)
    (first / "result.yaml").write_text("- " * 90_000)
    for options in ("", "--csv", "--json", "--where 'seed > 3' --sort seed"):
        done = invoke("runs --runs", thirty, options)
        assert done.exit_code == 0, done.exception
        assert "felt" in done.stdout
    assert list_runs(thirty)[0].outcome == "broken"
    page = thirty / "runs.html"
    invoke(f"runs --runs {thirty} --html {page}")
    assert 'href="%FF%26/report.html"' in page.read_text()
