"""A proposed mapping of strange tables, once its errors are stated, brings the numbers
back.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from cell.record.run import read_run
from drivers.base.types import Array
from tests.support.commands import invoke
from tests.support.foreign_tables import LENGTH, STAMPS, T, X, Z

PITCH = np.clip(T, 0.0, 1.0) * np.pi / 2
# of a tool, as quaternions
TILTS = [0 * T, -np.sin(PITCH / 2), 0 * T, -np.cos(PITCH / 2)]
ALONG = np.linspace(0.0, 1.0, 12)
ISO = [f"2026-01-31T12:00:{t:06.3f}Z" for t in T]
STRANGE = {  # head, columns, and what stands between them and in their numbers
    "a robot's log": (
        "tMs,tcp_x_mm,tcp_y_mm,tcp_z_mm",
        [1e3 * T, 1e3 * X, T, 1e3 * Z],
        ",",
    ),
    "a spreadsheet": (
        "Zeitstempel;X [cm];Höhe [mm];Fz [N]",
        [T, 1e2 * X, 1e3 * Z, 0.2 * Z],
        ";",
    ),
    "the other way": (
        "t\tx\tz\tv",
        [1e9 * (T + 9), 1e3 * (1.2 - X), -1e2 * (Z + 0.5), T],
        "\t",
    ),
    "with a date": ("% log\nstamp,x,z", [ISO, X - LENGTH, Z + 0.2], ","),
    "a planar camera": (
        "時刻|先端X|高さ|角度[度]",
        [T, 1e3 * X, 1e3 * Z, -57.29578 * PITCH],
        "|",
    ),
    "a tool's poses": ("t,q_x,q_y,q_z,q_w,x,z", [T, *TILTS, X, Z], ","),
    "two rows of names": ("Tool,,\nt,x,z\nms,mm,mm", [1e3 * T, 1e3 * X, 1e3 * Z], ","),
    "commands beside": (
        "x_cmd;z_cmd;x;z;stamp",
        [X + 9, Z + 9, X, 1e3 * Z, 1e6 * T],
        ";",
    ),
}


def tables(place: Path, head: str, columns: list[Array], mark: str) -> Path:
    """A folder with the gripper's table, and a profile in metres that ends at the
    gripper.
    """
    place.mkdir(parents=True)
    rows = zip(
        *(c if c is ISO else [f"{v:.9f}" for v in c] for c in columns), strict=True
    )
    text = "\n".join(map(mark.join, rows)).replace(".", "," if mark == ";" else ".")
    (place / "tip.csv").write_text(f"{head}\n{text}\n", encoding="utf-8")
    lines = ["t,x,z"]
    clock = {"the other way": 9.0, "with a date": 1769860800.0}.get(place.name, 0.0)
    for stamp, x, z in zip(
        STAMPS, *(np.interp(STAMPS, T, axis) for axis in (X, Z)), strict=True
    ):
        lines += [f"{stamp + clock},{0.3 + a * (x - 0.3)},{z * a**2}" for a in ALONG]
    (place / "points.csv").write_text("\n".join(lines))
    (place / "touch.csv").write_text(
        f"time,upper_mm,lower_mm\n{2.8 + clock},299,301.5\n"
    )
    return place


def proposed(place: Path, *words: str) -> tuple[str, str]:
    """The proposed mapping, and what is said where it is imported as it is proposed."""
    how = place.parent / "proposal.yaml"
    done = invoke("import --guess", place, "--out", how, *words)
    assert done.exit_code == 0, done.exception
    assert how.read_text() in done.stdout
    done = invoke("import", place, "--mapping", how, "--out", place.parent / "runs")
    return how.read_text(), str(done.exception)


@pytest.mark.parametrize("name", STRANGE)
def test_a_proposal_brings_the_numbers_back(tmp_path: Path, name: str) -> None:
    place = tables(tmp_path / name, *STRANGE[name])
    text, said = proposed(place, "--strip denim")
    assert {*re.findall(r"(\w+): null", text)} - {"force"} == {
        *re.findall(r"sigma\.(\w+):", said)
    }
    (tmp_path / "proposal.yaml").write_text(text.replace("null", "0.001"))
    places = f"--mapping {tmp_path}/proposal.yaml --out {tmp_path}/runs"
    done = invoke("import", place, places)
    assert done.exit_code == 0, (text, done.exception)
    run = read_run(tmp_path / "runs" / name)
    assert np.allclose([run.ticks.t, run.ticks.x, run.ticks.z], [T, X, Z], atol=1e-5)
    assert np.allclose(run.profile.x[11::12], np.interp(STAMPS, T, X), atol=1e-3)
    assert np.allclose(
        [run.result.t_layer_touch, run.result.displacement], [2.8, -0.0025]
    )
    assert "pitch:" not in text or np.allclose(run.ticks.pitch, PITCH, atol=1e-6)


def test_what_cannot_be_told_is_open_and_refused_by_its_name(tmp_path: Path) -> None:
    place = tables(tmp_path / "a", "t,x [m],z,gain", [T, 1e3 * X, Z + 0.1, T], ",")
    text, said = proposed(place)
    for key in (
        "strip",
        "sigma.gripper",
        "ticks.columns.x.unit",
        "profile.columns.x.unit",
    ):
        assert f"proposal.yaml: {key}: is null" in said
    assert (
        'z: {column: "z", unit: "m", offset: 0.1}  # likely, by its range, zero by'
        in text
    )
    assert '"tip.csv": gain; ' in text
    _, said = proposed(tables(tmp_path / "b/c", "t,x,hoch", [T, X, Z], ","))
    assert "ticks.columns.z.column: is null" in said
    again = invoke(f"import --guess {place} --out {place}")
    assert "is there already" in str(again.exception)


def test_a_camera_s_long_table_alone_is_midlines_without_a_gripper(tmp_path) -> None:
    place = tmp_path / "a"
    place.mkdir()
    rows = [
        f"{stamp:.3f};{image};{i};{300 + 0.3 * i:.1f};{0.2 * i:.1f}"
        for image, stamp in enumerate(STAMPS)
        for i in range(12)
    ]
    text = "\n".join(["Zeit;Bild;Punkt;Weg [mm];Höhe [mm]", *rows])
    (place / "kamera.csv").write_text(text.replace(".", ","), encoding="utf-8")
    text, said = proposed(place, "--strip denim")
    assert "file: null  # open: no table holds the gripper's path" in text
    for quantity, column in {"i": "Punkt", "x": "Weg [mm]", "z": "Höhe [mm]"}.items():
        assert f'{quantity}: {{column: "{column}"' in text.partition("profile:")[2]
    assert "ticks.file: is null" in said
