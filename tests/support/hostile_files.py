"""Files and run folders as nobody should write them, drawn by hypothesis."""

import json
import math
import os
import shutil
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from hypothesis import strategies as st

NUMBERS = [0, -1, 1, 1e-300, 1e300, -1e300, 10**20, -5, math.inf, math.nan, 0.5, 1e9, 3, 2**63]
WORDS = [
    "",
    "x",
    "²",
    "\ud800",
    "\x1b[31m",
    "[/red]",
    "banana",
    "a" * 5000,
    "../..",
    "nan",
    "1e400",
]
ODD = [*NUMBERS, *WORDS, None, True, [], {}, [[]], {"a": {"b": 1}}, [1, "x"], {"": 0}]
RAW = [
    b"",
    b"\xff\xfe\x00",
    b"\x00" * 40,
    b"[" * 5000,
    b"{" * 100_000,
    b"a: &a [x, x]\n" + b"".join(b"%c: &%c [*%c, *%c]\n" % (98 + i, 98 + i, 97 + i, 97 + i)
                                  for i in range(20)),
    b"a: &a [*a]\n",
    b"a: " + b"1:" * 60_000 + b"1\n",
    b"a: 0x" + b"f" * 9000,
    b"a: !!timestamp x\n",
    b'a: !!int ""\n',
    b"a: !!python/object/apply:os.system [ls]\n",
    b"2001-01-01: 1\n",
    b"schema: 10000000000000000000000\n",
    b"schema: 2\n",
    b"? [a]\n: 1\n",
    b"- 1\n",
    b"PAR1" + b"\x15" * 60 + b"PAR1",
    b"\x89PNG\r\n\x1a\n" + b"\x00" * 8 + b"\xff" * 30,
]  # fmt: skip
LINES = [
    b'{"t": 1e400, "kind": "state"}',
    b'{"t": ' + b"9" * 400 + b', "kind": "origin"}',
    b'{"t": NaN, "kind": "origin"}',
    b'{"a":' * 100_000,
    b'{"kind": "x", "deep": ' + b"[" * 900 + b"]" * 900 + b"}",
    b'{"t": true, "kind": ["x"], "name": {"a": 1}}',
    b'{"sequence": Infinity, "stamp": 1, "arrival": 2}',
    b'{"sequence": -3, "stamp": 1, "arrival": 2}',
    b'{"sequence": 1, "stamp": NaN, "arrival": 2, "sha256": 7}',
    b'{"kind": "decision", "sequence": 1e300, "time": "x"}',
    b'{"kind": "preflight", "checks": [1, {"name": []}, null]}',
    b'{"kind": "fault", "t": 5}',
    b"null",
    b"[1, 2]",
    b"\xff\xff",
]
PLACES = st.integers(0, 2**31)


def _paths(content: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = list(content.items()) if isinstance(content, dict) else []
    inner = list(enumerate(content)) if isinstance(content, list) else inner
    return [p for key, value in inner for p in [(*here, key), *_paths(value, (*here, key))]]


@st.composite
def documents(draw: st.DrawFn, whole: dict[str, Any]) -> bytes:
    """A YAML or JSON file: `whole` with some values changed, or bytes that mean nothing."""
    if draw(st.integers(0, 5)) == 0:
        return draw(st.sampled_from(RAW) | st.binary(max_size=80))
    content = json.loads(json.dumps(whole))
    for _ in range(draw(st.integers(1, 3))):
        paths = _paths(content)
        if not paths:
            break
        *way, last = paths[draw(PLACES) % len(paths)]
        inner = content
        for key in way:
            inner = inner[key]
        if isinstance(inner, dict) and draw(st.integers(0, 4)) == 0:
            del inner[last]
        else:
            odd = draw(st.sampled_from(ODD) | st.floats() | st.text(max_size=5))
            inner[last] = deepcopy(odd)  # what is changed inside it must not be odd for ever
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True).encode(errors="replace")
    cut = draw(st.integers(0, 9))
    return text[: draw(PLACES) % (len(text) + 1)] if cut == 0 else text


Spoil = Callable[[Path], None]


@dataclass(frozen=True)
class Spoiled:
    """A change to one file of a run folder; `name` tells which."""

    name: str
    spoil: Spoil

    def __repr__(self) -> str:
        return self.name


@st.composite
def spoilers(draw: st.DrawFn, folder: Path) -> Spoiled:
    """One file of a run like that in `folder`, spoiled."""
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    name = draw(st.sampled_from(files))
    content = (folder / name).read_bytes()
    kinds: list[Callable[[st.DrawFn, Path, bytes], Spoiled]] = [_kind, _bytes]
    if name.suffix == ".yaml":
        kinds += [_document] * 6
    if name.suffix == ".parquet":
        kinds += [_table] * 8
    if name.suffix == ".jsonl":
        kinds += [_lines] * 4
    return draw(st.sampled_from(kinds))(draw, name, content)


def _kind(draw: st.DrawFn, name: Path, _content: bytes) -> Spoiled:
    makers: dict[str, Spoil] = {
        "gone": lambda path: path.unlink(),
        "folder": lambda path: (path.unlink(), path.mkdir()),  # type: ignore[dict-item]
        "pipe": lambda path: (path.unlink(), os.mkfifo(path)),  # type: ignore[dict-item]
        "endless": lambda path: (path.unlink(), path.symlink_to("/dev/zero")),  # type: ignore[dict-item]
        "loop": lambda path: (path.unlink(), path.symlink_to(path)),  # type: ignore[dict-item]
    }
    what = draw(st.sampled_from(sorted(makers)))
    return Spoiled(f"{name} {what}", lambda folder: makers[what](folder / name))


def _bytes(draw: st.DrawFn, name: Path, content: bytes) -> Spoiled:
    made = bytearray(content)
    how = draw(st.sampled_from(["raw", "cut", "flip"]))
    if how == "raw" or not made:
        made = bytearray(draw(st.sampled_from(RAW)))
    elif how == "cut":
        made = made[: draw(PLACES) % len(made)]
    else:
        for _ in range(draw(st.integers(1, 5))):
            made[draw(PLACES) % len(made)] = draw(st.integers(0, 255))
    return _written(name, bytes(made), how)


def _document(draw: st.DrawFn, name: Path, content: bytes) -> Spoiled:
    return _written(name, draw(documents(yaml.safe_load(content))), "document")


def _lines(draw: st.DrawFn, name: Path, content: bytes) -> Spoiled:
    lines = content.split(b"\n")
    for line in draw(st.lists(st.sampled_from(LINES), min_size=1, max_size=4)):
        lines.insert(draw(PLACES) % len(lines), line)
    return _written(name, b"\n".join(lines), "lines")


def _table(draw: st.DrawFn, name: Path, content: bytes) -> Spoiled:
    table = pq.read_table(pa.BufferReader(content))
    how = draw(
        st.sampled_from(["value", "unit", "drop", "type", "rows", "shuffle", "schema", "null"])
    )
    at = draw(PLACES) % table.num_columns
    column = table.column_names[at]
    values = table[column].to_pylist()
    if how == "value" and values:
        values[draw(PLACES) % len(values)] = draw(
            st.sampled_from([n for n in NUMBERS if n != 2**63])
        )
        table = _replaced(table, at, values)
    elif how == "null" and values:
        values[draw(PLACES) % len(values)] = None
        table = _replaced(table, at, values)
    elif how == "unit" and values:
        table = _replaced(table, at, [v if isinstance(v, str | None) else 1e3 * v for v in values])
    elif how == "shuffle":
        table = _replaced(table, at, values[::-1])
    elif how == "drop":
        table = table.drop_columns([column])
    elif how == "type":
        other = draw(st.sampled_from([pa.string(), pa.bool_(), pa.int64(), pa.list_(pa.int8())]))
        table = table.set_column(at, column, pa.nulls(table.num_rows, other))
    elif how == "rows":
        table = table.slice(0, draw(st.sampled_from([0, 1, 2])))
    schema = draw(st.sampled_from(["²", "2", "", "9" * 5000, "x"])) if how == "schema" else "1"
    marked = table.replace_schema_metadata({"schema": schema})

    def write(folder: Path) -> None:
        (folder / name).unlink()
        with (folder / name).open("wb") as file:
            pq.write_table(marked, file)

    return Spoiled(f"{name} {how} {column}", write)


def _replaced(table: pa.Table, at: int, values: list[Any]) -> pa.Table:
    try:
        column = pa.array(values, table.schema.field(at).type)
    except (pa.ArrowException, OverflowError, TypeError):
        column = pa.array([None if v is None else str(v) for v in values])
    return table.set_column(at, table.column_names[at], column)


def _written(name: Path, content: bytes, how: str) -> Spoiled:
    def write(folder: Path) -> None:
        (folder / name).unlink()  # it may be a pipe by now
        (folder / name).write_bytes(content)

    return Spoiled(f"{name} {how} {content[:200]!r}", write)


def copied(folder: Path, to: Path, *changes: Spoiled) -> Path:
    """A copy of the run in `folder` at `to`, changed."""
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(folder, to)
    for change in changes:
        try:
            change.spoil(to)
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            continue  # the same file was spoiled before
    return to
