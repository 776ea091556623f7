"""Logs of a mechanism come in by every door, with one kind of mapping, and are read by
the fit.
"""

import json
from collections.abc import Mapping
from contextlib import chdir
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pytest
import yaml
from mcap.writer import Writer

from cell.gap.subject.run_table import read_table
from drivers.base.types import Array
from tests.support.commands import invoke
from tests.support.mechanisms import PRESCRIBED, make_arm

DEGREES = 180 / np.pi
# by column of the runs: column of a table, part of a vector, factor and keys
FOREIGN = {
    "t": ("ms", "ms", 1e3, {"unit": "ms"}),
    "shoulder": ("j1", "q.0", DEGREES, {"unit": "deg"}),
    "elbow": ("j2", "q.1", -DEGREES, {"unit": "deg", "reversed": True}),
    "t1": ("i1", "i.0", 1e3, {"unit": "mN m"}),
    "t2": ("i2", "i.1", 1 / 0.31, {"unit": "N m", "factor": 0.31}),
}


def write(kind: str, logs: list[Mapping[str, Array]], place: Path) -> list[Path]:
    """Write logs as other programs do, a file for each."""
    paths = [place / f"{i:02d}.{kind}" for i in range(len(logs))]
    for path, log in zip(paths, logs, strict=True):
        if kind != "mcap":
            named = {FOREIGN[name][0]: log[name] for name in FOREIGN}
            pc.write_csv(pa.table(named), path)
            continue
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            joints = writer.register_channel("/joints", "json", 0)
            for t, q1, q2, i1, i2 in zip(*log.values(), strict=True):
                row = {"ms": t, "q": [q1, q2], "i": [i1, i2]}
                writer.add_message(joints, round(1e6 * t), json.dumps(row).encode(), 0)
            writer.finish()
    return paths


@pytest.mark.parametrize(
    ("kind", "file"),
    [
        ("csv", "*.csv"),
        ("mcap", "/joints"),
    ],
)
def test_logs_of_an_arm_become_runs_that_the_workflow_reads(
    tmp_path, kind, file
) -> None:
    model, runs = make_arm(tmp_path / "an arm", 2, content=PRESCRIBED)
    known = [
        read_table(folder / "signals.parquet") for folder in sorted(runs.iterdir())
    ]
    logs = [
        {name: way[2] * each[name] for name, way in FOREIGN.items()} for each in known
    ]
    how = {
        name: {"column": way["*" not in file], **way[3]}
        for name, way in FOREIGN.items()
    }
    place = {"load": {"body": "lower", "mass": 0.01}, "origin": "monday"}
    content = {
        "schema": 1,
        "mechanism": "arm",
        "runs": {"01": place},
    }
    (tmp_path / "logs").mkdir()
    out, mapping = tmp_path / "own runs", tmp_path / "mapping.yaml"
    words = ["import", *write(kind, logs, tmp_path / "logs"), "--model", model]
    words += ["--mapping", mapping, "--out", out]
    signals = {"file": file, "columns": how}
    for columns in ({"t2": how.pop("t2")}, {}):
        mapping.write_text(yaml.safe_dump({**content, "signals": signals}))
        done = invoke(*words)
        how |= columns
        assert bool(columns) == (
            ", as mapped: t2: this column is missing" in str(done.exception)
        )
    assert "3.00 s; 600 rows of elbow, shoulder, t1, t2" in done.stdout, done.exception
    for folder, was in zip(sorted(out.iterdir()), known, strict=True):
        now = read_table(folder / "signals.parquet")
        assert all(np.allclose(now[name], was[name], atol=1e-9) for name in FOREIGN)
    head = yaml.safe_load((folder / "run.yaml").read_text())
    assert (head["index"], head["origin"], head["load"]["mass"]) == (1, "monday", 0.01)
    _, _, following = done.stdout.partition("next: cell ")
    assert invoke(following).exit_code == 0


def test_torques_may_have_a_table_and_a_clock_of_their_own(tmp_path) -> None:
    """Slower ones are absent between, faster ones are thinned, none is late."""
    model, runs = make_arm(tmp_path / "arm", 1, content=PRESCRIBED)
    known = read_table(next(runs.iterdir()) / "signals.parquet")
    (tmp_path / "log").mkdir()
    tables = []
    for names, rate in (
        (("shoulder", "elbow"), 200.0),
        (("t1",), 61.0),
        (("t2",), 731.0),
    ):
        t = np.arange(0.001, 2.9, 1.0 / rate)
        columns = {n: np.interp(t, known["t"], known[n]) for n in names}
        pc.write_csv(pa.table({"t": t, **columns}), tmp_path / f"log/{names[0]}.csv")
        units = dict.fromkeys(names, "rad" if rate == 200.0 else "N m") | {"t": "s"}
        how = {n: {"column": n, "unit": unit} for n, unit in units.items()}
        tables.append({"file": f"{names[0]}.csv", "columns": how})
    content = {"schema": 1, "mechanism": "arm", "signals": tables}
    (tmp_path / "mapping.yaml").write_text(yaml.safe_dump(content))
    words = f"import log --model {model} --mapping mapping.yaml --out runs"
    with chdir(tmp_path):
        done = invoke(words)
    assert done.exit_code == 0, done.exception
    now = read_table(tmp_path / "runs/log/signals.parquet")
    assert (np.isfinite(now["t1"]).sum(), np.isfinite(now["t2"]).mean()) == (177, 1.0)
    for name in ("t1", "t2"):
        there = np.isfinite(now[name])
        right = np.interp(now["t"][there], known["t"], known[name])
        assert np.abs(now[name][there] - right).max() < 0.02 * np.ptp(known[name])
