"""Runs as other programs write them, and mappings that import them."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

LENGTH = 0.6
T = np.arange(0.0, 3.0, 0.01)
X = LENGTH - 0.1 * np.clip(T - 0.5, 0.0, None)
Z = 0.06 * np.clip(T, 0.0, 0.5) / 0.5 + 0.08 * np.clip(T - 0.5, 0.0, None)
STAMPS = np.arange(0.503, 2.9, 1 / 30)
CONTACT = np.interp(STAMPS, T, X) - 0.28
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
  columns: {t: {column: t, unit: s}, x: {column: p.x, unit: m}, z: {column: p.z, unit: m}}
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
    """Write a run with x reversed, another clock, and images 20 ms late."""
    place.mkdir(parents=True)
    columns = [
        1e3 * (T + clock),
        1e3 * (1.2 - X),
        1e2 * (Z + 0.05),
        1e3 * 0.2 * np.sin(T),
    ]
    table(
        place / "tip.csv",
        ["time", "along", "height", "Fx"],
        columns,
        delimiter=";",
        decimal=",",
    )
    t = np.repeat(STAMPS + clock + 0.02, len(POINTS))
    x = np.concatenate([np.interp(s, T, X) + 0.3 * (POINTS - 1.0) for s in STAMPS])
    z = np.concatenate([np.interp(s, T, Z) * POINTS**2 for s in STAMPS])
    points = [{"x": a, "z": [b]} for a, b in zip(x, z, strict=True)]
    pq.write_table(pa.table({"t": t, "p": points}), place / "points.parquet")
    table(place / "contact.csv", ["t", "c"], [STAMPS + clock + 0.02, 1e3 * CONTACT])
    table(
        place / "touch.csv", ["t", "upper", "lower"], [[clock + 2.8], [299.0], [301.5]]
    )
    return place


def mapping(place: Path, **changes: object) -> Path:
    path = place / "mapping.yaml"
    content = {
        key: value for key, value in (MAPPING | changes).items() if value is not None
    }
    path.write_text(yaml.safe_dump(content))
    return path


def plain(place: Path, head: str = "t,x,z", rows: object = None, **how: str) -> Path:
    """Write a folder with one table of the gripper's path, `rows` as text."""
    place.mkdir(parents=True)
    made = [f"{t:.3f},{x:.6f},{z:.6f}" for t, x, z in zip(T, X, Z, strict=True)]
    lines = [head, *(made if rows is None else rows)]
    (place / "tip.csv").write_text("\n".join(lines), **how)
    return place


def in_metres(place: Path, **changes: object) -> Path:
    """Write a mapping in metres for the tables of `plain` and the touch of
    `foreign`.
    """
    columns = {
        n: {"column": n, "unit": unit}
        for n, unit in {"t": "s", "x": "m", "z": "m"}.items()
    }
    ticks = {"file": "tip.csv", "columns": columns}
    return mapping(
        place, **{"ticks": ticks, "profile": None, "contact": None} | changes
    )
