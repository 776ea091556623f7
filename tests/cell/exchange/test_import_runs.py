"""Runs of another laboratory: imported, they hold what was measured, in our units and frame."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from typer.testing import CliRunner

from cell.cli.app import app
from cell.record.documents import write_document
from cell.record.exchange.import_runs import import_runs
from cell.record.run import read_run
from drivers.errors import ConfigurationError

LENGTH = 0.6
T = np.arange(0.0, 3.0, 0.01)
X = LENGTH - 0.1 * np.clip(T - 0.5, 0.0, None)
Z = 0.06 * np.clip(T, 0.0, 0.5) / 0.5 + 0.08 * np.clip(T - 0.5, 0.0, None)
STAMPS = np.arange(0.503, 2.9, 1 / 30)
CONTACT = 0.4 - 0.05 * STAMPS
POINTS = np.linspace(0.0, 1.0, 12)
MAPPING = yaml.safe_load("""
schema: 1
strip: denim
condition: slow
sigma: {gripper: 1.0e-4, contact_x: 2.0e-3, profile: 1.0e-3, displacement: 3.0e-3}
ticks:
  file: tip.csv
  columns:
    t: {column: time, unit: ms}
    x: {column: along, unit: mm, offset: 1.2, reversed: true}
    z: {column: height, unit: cm, offset: 0.05}
    f_x: {column: Fx, unit: mN}
profile:
  file: points.parquet
  late: 0.02
  columns: {t: {column: t, unit: s}, x: {column: x, unit: m}, z: {column: z, unit: m}}
contact:
  file: contact.csv
  late: 0.02
  columns: {t: {column: t, unit: s}, contact_x: {column: c, unit: mm}}
result:
  file: touch.csv
  columns:
    t_layer_touch: {column: t, unit: s}
    l1: {column: upper, unit: mm}
    l2: {column: lower, unit: mm}
""")


def table(path: Path, head: list[str], columns: list[object], **style: str) -> None:
    rows = [head, *(map(repr, row) for row in np.column_stack(columns).tolist())]
    text = "\n".join(style.get("delimiter", ",").join(row) for row in rows)
    path.write_text(text.replace(".", style.get("decimal", ".")))


def foreign(place: Path, clock: float = 1700.0) -> Path:
    """A run as another program wrote it: x the other way, its own clock, images 20 ms late."""
    place.mkdir(parents=True)
    columns = [1e3 * (T + clock), 1e3 * (1.2 - X), 1e2 * (Z + 0.05), 1e3 * 0.2 * np.sin(T)]
    table(place / "tip.csv", ["time", "along", "height", "Fx"], columns, delimiter=";", decimal=",")
    t = np.repeat(STAMPS + clock + 0.02, len(POINTS))
    x = np.tile(0.2 + 0.3 * POINTS, len(STAMPS))
    z = np.tile(0.1 * POINTS**2, len(STAMPS))
    pq.write_table(pa.table({"t": t, "x": x, "z": z}), place / "points.parquet")
    table(place / "contact.csv", ["t", "c"], [STAMPS + clock + 0.02, 1e3 * CONTACT])
    table(place / "touch.csv", ["t", "upper", "lower"], [[clock + 2.8], [299.0], [301.5]])
    return place


def mapping(place: Path, **changes: object) -> Path:
    path = place / "mapping.yaml"
    content = {key: value for key, value in (MAPPING | changes).items() if value is not None}
    path.write_text(yaml.safe_dump(content))
    return path


def test_imported_run_holds_what_was_measured(tmp_path: Path) -> None:
    [made] = import_runs([foreign(tmp_path / "a")], mapping(tmp_path), tmp_path / "runs")
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
    assert np.allclose(curves[0][1][:, 0], 0.2 + 0.3 * POINTS)
    assert run.result.displacement == pytest.approx(-0.0025)
    assert run.result.t_layer_touch == pytest.approx(2.8, abs=1e-6)


def test_a_unit_of_another_quantity_is_refused(tmp_path: Path) -> None:
    change = {"columns": MAPPING["ticks"]["columns"] | {"t": {"column": "time", "unit": "mm"}}}
    how = mapping(tmp_path, ticks=MAPPING["ticks"] | change)
    with pytest.raises(ConfigurationError, match="t: unit 'mm' is not known"):
        import_runs([foreign(tmp_path / "a")], how, tmp_path / "runs")


def test_command_imports_and_names_the_next_one(tmp_path: Path) -> None:
    folder, how = foreign(tmp_path / "a"), mapping(tmp_path)
    words = ["import", str(folder), "--mapping", str(how), "--out", str(tmp_path / "runs")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "a: 2.99 s; 72 images, touch at 2.80 s" in done.stdout
    assert "next: cell gap fit" in done.stdout
    again = CliRunner().invoke(app, words)
    assert "is there already" in str(again.exception)


def plain(place: Path, head: str = "t,x,z", rows: object = None, **how: str) -> Path:
    """A folder with a table of the gripper, of rows as text."""
    place.mkdir(parents=True)
    made = [f"{t:.3f},{x:.6f},{z:.6f}" for t, x, z in zip(T, X, Z, strict=True)]
    lines = [head, *(made if rows is None else rows)]
    (place / "tip.csv").write_text("\n".join(lines), **how)
    return place


def in_metres(place: Path, **changes: object) -> Path:
    """A mapping for `plain`, and for the touch of `foreign`."""
    units = {"t": "s", "x": "m", "z": "m"}
    columns = {name: {"column": name, "unit": unit} for name, unit in units.items()}
    ticks = {"file": "tip.csv", "columns": columns}
    return mapping(place, **{"ticks": ticks, "profile": None, "contact": None} | changes)


@pytest.mark.parametrize(
    ("head", "rows", "how", "said"),
    [
        ("tt,x,z", None, {}, "column 't' for t is not there (did you mean 'tt'?)"),
        ("t,x,z", [], {}, "holds 0 rows of numbers, must hold two at least"),
        ("t,x,z", ["0,NA,0", "1,off,0"], {}, "holds string ('off' in row 2), must hold numbers"),
        ("t,x,z,Höhe", ["0,0.6,0,0"], {"encoding": "latin-1"}, "is not UTF-8 text; save it"),
        ("t,x,z", ["0,0.6,0"], {"encoding": "utf-16"}, "is not UTF-8 text; save it"),
        ("t,x,z", ["0,0.6,0", "10,0.6,0"], {}, "t: rows are 10 s apart, must be at most 0.2 s"),
        ("t,x,z", ["0,0.6,0", "0.01,nan,0"], {}, "x: row 1 is nan, must be a finite number; leave"),
        ("t,x,z", ["0,0.6,0", "0,0.6,0"], {}, "t: row 1 is 0 s after 0 s, times must increase"),
    ],
)
def test_table_that_cannot_be_used_is_refused_by_its_own_name(
    tmp_path, head, rows, how, said
) -> None:
    folder = plain(tmp_path / "a", head, rows, **how)
    with pytest.raises(ConfigurationError) as error:
        import_runs([folder], in_metres(tmp_path), tmp_path / "runs")
    assert str(error.value).startswith(f"{folder / 'tip.csv'}: ")
    assert said in str(error.value)
    assert not list((tmp_path / "runs").glob("*"))


@pytest.mark.parametrize("fault", [KeyboardInterrupt, ConfigurationError, MemoryError, None])
def test_import_that_ends_early_leaves_what_another_made(tmp_path, monkeypatch, fault) -> None:
    """None of its own runs; without a fault, another import makes one of them meanwhile."""
    folders, how, others = [plain(tmp_path / name) for name in "ab"], in_metres(tmp_path), []

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
