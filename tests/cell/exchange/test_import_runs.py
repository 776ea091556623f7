"""Runs of another laboratory: imported, they hold what was measured, in our units and
frame.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import cell
from cell.record.documents import write_document
from cell.record.exchange.import_runs import import_runs
from cell.record.files import runs_in
from cell.record.run import read_run
from drivers.base.errors import ConfigurationError
from tests.support.commands import invoke
from tests.support.dying import in_child
from tests.support.foreign_tables import (
    CONTACT,
    MAPPING,
    POINTS,
    STAMPS,
    T,
    X,
    Z,
    foreign,
    in_metres,
    mapping,
    plain,
)


def test_imported_run_holds_what_was_measured(tmp_path: Path) -> None:
    [made] = import_runs(
        [foreign(tmp_path / "a")], mapping(tmp_path), tmp_path / "runs"
    )
    run = read_run(made)
    assert (run.header.strip, run.header.condition) == ("denim", "slow")
    assert np.allclose([run.ticks.t, run.ticks.x, run.ticks.z], [T, X, Z], atol=1e-9)
    assert np.allclose(run.ticks.f_x, 0.2 * np.sin(T), atol=1e-9)
    seen = np.isfinite(run.ticks.contact_x)
    assert np.allclose(run.ticks.contact_x[seen], CONTACT, atol=1e-9)
    assert np.allclose(run.ticks.contact_t[seen], STAMPS, atol=1e-6)
    assert np.abs(run.ticks.t[seen] - STAMPS).max() <= 0.005 + 1e-6
    curves = run.profile.curves()
    assert [len(points) for _, points in curves] == [12] * len(STAMPS)
    assert np.allclose(curves[0][1][:, 0], X[50] - 3e-4 + 0.3 * (POINTS - 1.0))
    assert run.result.displacement == pytest.approx(-0.0025)
    assert run.result.t_layer_touch == pytest.approx(2.8, abs=1e-6)


def test_command_imports_and_names_the_next_one(tmp_path: Path) -> None:
    folder, how = foreign(tmp_path / "a"), mapping(tmp_path)
    how.write_text(how.read_text().replace("offset: 1.2", "offset: 1.1875"))
    words = f"import {folder} --mapping {how} --out {tmp_path}/runs"
    done = invoke(words)
    assert done.exit_code == 0, done.output
    assert "a: 2.99 s; 72 images, touch at 2.80 s\n1 run in" in done.stdout
    assert "next: import a second run into" in done.stdout
    page = (tmp_path / "runs" / "imported.html").read_text()
    for claim in (
        "Not recorded: commands",
        "side view of the strip",
        "Next: import a second run into",
        "touch at 2.80",
    ):
        assert claim in page, claim
    assert "off x 0.6, z 0 m by 0.012, at most 0.006 is usual" in done.stderr
    assert "is there already" in str(invoke(words).exception)


@pytest.mark.parametrize(
    ("table", "column", "change", "said"),
    [
        ("ticks", "t", {"unit": "mm"}, "t: unit 'mm' is not known"),
        ("ticks", "z", {"unit": "um", "offset": 0.0}, "z: rises less than 0.01 m"),
        (
            "result",
            "t_layer_touch",
            {"unit": "ms"},
            "unit: s for t_layer_touch of result (touch.",
        ),
        ("profile", "x", {"column": "p.z"}, "half the midlines"),
        (
            "ticks",
            "x_cmd",
            {"column": "height", "unit": "cm"},
            "z_cmd: half lie off the gripper",
        ),
        (
            "profile",
            "t",
            {"offset": 0.9},
            "points.parquet: x, z: half the midlines end off",
        ),
        (
            "profile",
            "t",
            {"offset": 0.09},
            "a: t: the midlines lead the gripper by 0.09",
        ),
        (
            "profile",
            "z",
            {"offset": 0.012},
            "a: z: half the midlines begin under the desk by 0.01",
        ),
        ("profile", "x", {"offset": 0.027}, "x, z: half the midlines end beside"),
        (
            "ticks",
            "pitch",
            {"column": "Fx", "unit": "deg"},
            "half the midlines leave its pitch",
        ),
        (
            "contact",
            "contact_x",
            {"offset": 0.6, "reversed": True},
            "half the contacts lie off",
        ),
        (
            "result",
            "l1",
            {"factor": 0.1},
            "touch.csv: l1: ends before the gripper by 0.2",
        ),
        (
            "result",
            "l1",
            {"factor": 2.0},
            "touch.csv: l1, l2: are longer than the strip",
        ),
    ],
)
def test_what_contradicts_a_held_strip_is_told(
    tmp_path, table, column, change, said
) -> None:
    columns = dict(MAPPING[table]["columns"])
    columns[column] = columns.get(column, {}) | change
    how = mapping(tmp_path, **{table: MAPPING[table] | {"columns": columns}})
    places = f"--mapping {how} --out {tmp_path}/runs"
    done = invoke("import", foreign(tmp_path / "a"), places)
    assert said in f"{done.stderr}{done.exception}"


@pytest.mark.parametrize(
    ("head", "rows", "how", "said"),
    [
        ("tt,x,z", None, {}, "column 't' for t is not there (did you mean 'tt'?)"),
        ("t,x,z", [], {}, "t: has 0 rows; at least 30 are needed"),
        (
            "t,x,z",
            ["0,0.6,0", '0,"1,234.5",0'],
            {},
            "write 1234.5 for 1,234.5, or leave the row",
        ),
        (
            "t,x,z",
            ["0,NA,0", "1,off,0"],
            {},
            "holds string ('off' in row 2), must hold numbers",
        ),
        ("t,x,z", ["0,0.6,0"], {"encoding": "utf-16"}, "is not UTF-8 text; save it"),
        (
            "t,x,z",
            ["0,0.6,0"] + [f"{t}0,.5,.2" for t in range(1, 50)],
            {},
            "apart by 10, at most",
        ),
        (
            "t,x,z",
            ["0,0.6,0", "0.01,nan,0"],
            {},
            "x: row 1 is nan, must be a finite number; leave",
        ),
        (
            "t,x,z",
            ["0,0.6,0", "0,0.6,0"],
            {},
            "t: row 1 is 0 s after 0 s, times must increase",
        ),
    ],
)
def test_unusable_table_is_refused_by_its_own_name(
    tmp_path, head, rows, how, said
) -> None:
    folder = plain(tmp_path / "a", head, rows, **how)
    with pytest.raises(ConfigurationError) as error:
        cell.import_runs([folder], tmp_path / "runs", in_metres(tmp_path))
    assert str(error.value).startswith(f"{folder / 'tip.csv'}: ")
    assert said in str(error.value)
    assert not list((tmp_path / "runs").glob("*"))


@pytest.mark.parametrize(
    "fault", [KeyboardInterrupt, ConfigurationError, MemoryError, None]
)
def test_import_that_ends_early_leaves_what_another_made(
    tmp_path, monkeypatch, fault
) -> None:
    """None of its own runs; without a fault, another import makes one of them
    meanwhile.
    """
    folders, how, others = (
        [plain(tmp_path / name) for name in "ab"],
        in_metres(tmp_path),
        [],
    )

    def disturb(path: Path, content: object) -> None:
        if path.parent.name == "b":
            monkeypatch.undo()
            if fault is not None:
                raise fault
            others.extend(import_runs(folders[1:], how, tmp_path / "runs"))
        write_document(path, content)

    monkeypatch.setattr("cell.record.exchange.import_runs.write_document", disturb)
    with pytest.raises(fault or ConfigurationError):
        import_runs(folders, how, tmp_path / "runs")
    assert list((tmp_path / "runs").glob("*")) == others
    assert len(import_runs(folders[: 2 - len(others)], how, tmp_path / "runs")) > 0


@pytest.mark.slow
def test_import_that_is_killed_leaves_all_runs_or_none_to_the_next(tmp_path) -> None:
    how, folders = in_metres(tmp_path), [plain(tmp_path / name) for name in "abc"]
    seen: set[int] = set()
    for moment in range(200):
        out, told = tmp_path / f"runs-{moment}", []
        make = partial(import_runs, mapping=how, out=out)
        code = in_child(partial(make, folders[:2]), dies_at=moment)
        make(folders[2:], tell=told.append)
        names = "".join(run.name for run in runs_in(out))
        assert names in ("c", "abc")
        seen.add(len(told))
        if code == 0:
            break
    assert (names, seen) == ("abc", {0, 1, 2})
