"""The catalogue of runs: always as the folders are, quick over many of them, and read only."""

import json
import os
import time
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from cell.cli.app import app
from cell.record.catalogue import Catalogue
from cell.record.listing import read_row
from cell.record.scalars import read_scalars
from cell.record.writer import RunWriter
from drivers.errors import ConfigurationError
from tests.cell.conftest import HEADER
from tests.support.listed_runs import list_runs

RESULT = "outcome: {}\ndisplacement: {}\nedge_offset: {}\nforetold: {{displacement: 1e-3}}\n"


def lay(root: Path, number: int, outcome: str = "layer_touch") -> Path:
    """A run of the cell without its tables."""
    minute, second = divmod(number, 60)
    hour, minute = divmod(minute, 60)
    folder = root / f"20261120T{hour:02d}{minute:02d}{second:02d}Z-denim-fold-{number:04x}"
    folder.mkdir(parents=True)
    (folder / "run.yaml").write_text(f"schema: 1\nstrip: s{number % 3}\nseed: {number}\n")
    (folder / "result.yaml").write_text(RESULT.format(outcome, number * 1e-4, -number * 1e-5))
    return folder


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    return tmp_path / "cache"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for number in range(30):
        lay(tmp_path / "runs", number, "layer_touch" if number % 5 else "overspeed")
    return tmp_path / "runs"


def names(root: Path, cache: Path, where: str = "", sort: str = "") -> list[str]:
    with Catalogue(root, cache) as catalogue:
        return [row.name for row in catalogue.rows(where, sort)]


def test_catalogue_lists_what_the_folders_hold(root, cache, finished) -> None:
    for place in (root, finished.parent):
        for _ in range(2):  # read, and from the cache
            with Catalogue(place, cache) as catalogue:
                assert catalogue.rows() == list_runs(place)


def test_cache_follows_every_change_of_the_folders(root, cache) -> None:
    first = names(root, cache)
    lay(root, 30)
    (root / first[0] / "result.yaml").unlink()
    for path in (root / first[1]).iterdir():
        path.unlink()
    (root / first[1]).rmdir()
    text = (root / first[2] / "run.yaml").read_text()
    time.sleep(0.01)
    (root / first[2] / "run.yaml").write_text(text.replace("strip: s2", "strip: silk"))
    with Catalogue(root, cache) as catalogue:
        rows = catalogue.rows()
    assert rows == list_runs(root)
    assert len(rows) == 30
    assert rows[0].outcome == "died"
    assert rows[1].strip == "silk"


def test_broken_or_foreign_cache_is_made_anew(root, cache) -> None:
    expected = names(root, cache)
    [path] = cache.iterdir()
    path.write_bytes(b"SQLite format 3\0" + os.urandom(4096))
    assert names(root, cache) == expected
    path.unlink()
    path.mkdir()
    assert names(root, cache) == expected


def test_run_under_way_is_read_again_each_time(tmp_path, cache) -> None:
    writer = RunWriter.create(tmp_path / "runs", HEADER, "none")
    with Catalogue(tmp_path / "runs", cache) as catalogue:
        assert [row.outcome for row in catalogue.rows()] == ["under way"]
    writer.close()
    with Catalogue(tmp_path / "runs", cache) as catalogue:
        assert [row.outcome for row in catalogue.rows()] == ["died"]


def test_runs_are_filtered_and_sorted(root, cache) -> None:
    with Catalogue(root, cache) as catalogue:
        some = catalogue.rows("outcome = 'layer_touch' and displacement > 0.002", "-edge_offset")
        assert [row.seed for row in some] == [21, 22, 23, 24, 26, 27, 28, 29]
        columns, rows = catalogue.query("SELECT strip, count(*) AS n FROM runs GROUP BY strip")
        assert columns == ("strip", "n")
        assert rows == [("s0", 10), ("s1", 10), ("s2", 10)]


@pytest.mark.parametrize(
    "sql",
    ["DELETE FROM runs", "DROP TABLE runs", "ATTACH 'x.db' AS x", "PRAGMA user_version = 9",
     "SELECT load_extension('x')", "SELECT nothing FROM runs", "SELECT 1; DELETE FROM runs", ""],
)  # fmt: skip
def test_query_can_only_read(root, cache, sql, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    before = names(root, cache)
    with Catalogue(root, cache) as catalogue:
        if sql:
            with pytest.raises(ConfigurationError, match="columns of runs: run, began, strip"):
                catalogue.query(sql)
        with pytest.raises(ConfigurationError, match="--where"):
            catalogue.rows("1); DELETE FROM runs; --")
    assert not (tmp_path / "x.db").exists()
    assert names(root, cache) == before


def test_unknown_column_to_sort_by_names_the_nearest(root, cache) -> None:
    with pytest.raises(ConfigurationError, match="did you mean 'displacement'"):
        names(root, cache, sort="-displacment")


def test_known_runs_are_listed_without_a_look_into_their_folders(root, cache, monkeypatch) -> None:
    names(root, cache)
    read: list[Path] = []

    def counted(folder: Path):
        read.append(folder)
        return read_row(folder)

    monkeypatch.setattr("cell.record.catalogue.read_row", counted)
    assert len(names(root, cache, "displacement > 0.0015", "-edge_offset")) == 14
    assert read == []
    new = lay(root, 30)
    assert len(names(root, cache)) == 31
    assert read == [new]


def test_scalars_are_read_as_the_document_has_them() -> None:
    text = (
        "a: 1\nb: {c: 0.5, d: {e: 1}, f: [1, 2]}\ng: [x, {y: z}]\nh: 'true'\ni: true\nj: null\n"
        "k: &q text\nl: *q\nm: 1e-3\nn: |\n  two\n  lines\n"
    )
    assert read_scalars(text) == {
        "a": 1.0, "b.c": 0.5, "h": "true", "i": True, "j": None, "k": "text", "m": 1e-3,
        "n": "two\nlines\n",
    }  # fmt: skip
    whole = yaml.safe_load(yaml.safe_dump(HEADER))
    found = read_scalars(yaml.safe_dump(HEADER))
    assert found["sigma.profile"] == whole["sigma"]["profile"]


@pytest.mark.parametrize("text", ["", "a", "- a", "a: [", "{[a]: b}", "a: b: c", "[" * 100_000])
def test_text_that_is_no_mapping_has_no_scalars(text) -> None:
    with pytest.raises(ValueError, match=r"YAML|mapping|word"):
        read_scalars(text)


def test_command_lists_csv_json_and_queries(root, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("COLUMNS", "160")
    run = CliRunner()
    some = ("runs", "--runs", str(root), "--where", "seed < 3")
    table = run.invoke(app, some).stdout
    assert "edge mm" in table
    assert "-0.0" in table
    lines = [json.loads(line) for line in run.invoke(app, [*some, "--json"]).stdout.splitlines()]
    assert [line["edge_offset"] for line in lines] == [-0.0, -1e-5, -2e-5]
    content = run.invoke(app, [*some, "--csv"]).stdout.splitlines()
    assert content[0].startswith("run,began,strip,policy,outcome,displacement,edge_offset")
    assert len(content) == 4
    sql = "SELECT max(seed) AS last FROM runs"
    asked = run.invoke(app, ["runs", "--runs", str(root), "--sql", sql, "--json"])
    assert json.loads(asked.stdout) == {"last": 29}
