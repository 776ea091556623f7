"""Import of measured runs: foreign tables are checked, converted, written as run folders."""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from cell.extras import require_library
from cell.record.columns import Profile, Ticks
from cell.record.documents import write_document
from cell.record.exchange.lerobot import INFO, episodes
from cell.record.exchange.mapping import (
    FILE,
    MAPPING,
    Folder,
    MappingFile,
    Place,
    Source,
    path_of,
    read_columns,
)
from cell.record.files import PROFILE, RESULT, RUN, TICKS, is_run
from cell.record.run import read_run
from cell.record.tables import place_contacts, write_parquet
from drivers.errors import ConfigurationError
from drivers.files import check_free, move_folder, replace_file, scratch_folder, writing
from drivers.settings import load, parse
from drivers.types import Array
from drivers.yaml_text import parse_yaml

NEEDED_COLUMNS = ("t", "x", "z")
LONGEST_INTERVAL = 0.2  # s between rows of the gripper; slower ones are in another unit than stated
SOON = 1.0  # s after the last row, within which a touch read off a stopwatch may lie


def import_runs(places: Sequence[Path], mapping: Path | None, out: Path) -> tuple[Path, ...]:
    """Import the runs in `places`, in that order; returns their new folders below `out`.

    A place is a folder of tables, a folder of such folders, an MCAP file, or a LeRobot data set;
    what `cell export` wrote brings its own mapping. All runs are written, or none. Raises
    ConfigurationError for tables that are missing or do not hold what `mapping` says, values that
    no run can have, or a run that is there already.
    """
    stated = None if mapping is None else _with_needed(load(mapping, MappingFile), str(mapping))
    sources = (source for place in places for source in _sources(place, mapping))
    with scratch_folder(out) as scratch:
        made: list[Path] = []
        for index, source in enumerate(sources):
            how, run = stated or _own_mapping(source), scratch / source.name
            check_free(out / run.name)
            if run in made:
                raise ConfigurationError(
                    f"{source.path}: is the second run named {run.name}; rename one"
                )
            made.append(run)
            with writing(out):
                _import(source, how, index, run, documents=stated is None)
            _check_readable(run, source)
        if not made:
            raise ConfigurationError(f"{places[0]}: holds no tables")
        return _move_all(made, out)


def _move_all(made: Sequence[Path], out: Path) -> tuple[Path, ...]:
    """Move the runs `made` to the folder `out`, all or none; returns their folders there."""
    moved: list[Path] = []
    try:
        for run in made:
            move_folder(run, out / run.name)
            moved.append(out / run.name)
    except BaseException:
        for run in moved:
            shutil.rmtree(run, ignore_errors=True)
        raise
    return tuple(moved)


def _check_readable(run: Path, source: Source) -> None:
    """Refuse a run that could not be read back; the error names its source."""
    try:
        read_run(run)
    except ConfigurationError as error:
        raise ConfigurationError(str(error).replace(str(run), str(source.path))) from None


def _sources(place: Path, mapping: Path | None) -> Iterator[Source]:
    """Sources of runs in `place`; none where it is the mapping file, which lies beside runs."""
    if place.suffix == ".mcap":
        require_library("mcap")
        from cell.record.exchange.mcap_file import McapFile

        yield McapFile(place)
    elif (place / INFO).is_file():
        yield from episodes(place)
    elif place.is_dir():
        yield from map(Folder, _table_folders(place))
    elif not (place.is_file() and (place.name == MAPPING or place == mapping)):
        fault = "is none of what is read" if place.exists() else "is not there"
        raise ConfigurationError(
            f"{place}: {fault}; give a folder with tables, an .mcap file or a LeRobot data set"
        )


def _table_folders(place: Path) -> list[Path]:
    """The folder `place` where it holds tables itself, or else the folders in it."""
    if any(FILE.fullmatch(path.name) for path in place.iterdir()):
        return [place]
    inner = sorted(path for path in place.iterdir() if path.is_dir())
    if not inner:
        raise ConfigurationError(f"{place}: holds no tables; give a folder with CSV or Parquet")
    return inner


def _own_mapping(source: Source) -> MappingFile:
    content = source.documents.get(MAPPING)
    if content is None and is_run(source.path):
        raise ConfigurationError(
            f"{source.path}: is a run already; `cell gap fit` takes it as it is"
        )
    if content is None:
        raise ConfigurationError(
            f"{source.path}: nothing says which column holds what; write a mapping file and give "
            "it with --mapping"
        )
    origin = f"{source.path}: {MAPPING}"
    text = content.decode(errors="replace")
    return _with_needed(parse(parse_yaml(text, origin), MappingFile, origin), origin)


def _with_needed(mapping: MappingFile, origin: str) -> MappingFile:
    missing = [name for name in NEEDED_COLUMNS if name not in mapping.ticks.columns]
    if missing:
        raise ConfigurationError(f"{origin}: ticks.columns.{missing[0]}: is missing; add it")
    return mapping


def _import(source: Source, how: MappingFile, index: int, target: Path, *, documents: bool) -> None:
    """Write the tables of `source` as a run, and with `documents` its own YAML files."""
    ticks = dict(read_columns(source, how.ticks, how.ticks.columns.items()))
    first = float(ticks["t"][0]) if len(ticks["t"]) else 0.0
    begin = first if how.begin is None else how.begin
    ticks["t"] = ticks["t"] - begin
    if "contact_t" in ticks:
        ticks["contact_t"] = ticks["contact_t"] - begin
    _check_ticks(ticks, path_of(source, how.ticks))
    if how.contact is not None:
        seen = read_columns(source, how.contact, how.contact.columns.items())
        placed = place_contacts(ticks["t"], seen["t"] - begin, seen["contact_x"])
        ticks |= dict(zip(("contact_x", "contact_t"), placed, strict=True))
    target.mkdir()
    write_document(target / RUN, _header(source.name, how, index))
    write_parquet(target / TICKS, pa.table(ticks))
    write_parquet(target / PROFILE, pa.table(_profile(source, how, begin)))
    if how.result is not None:
        write_document(target / RESULT, _result(source, how, begin, float(ticks["t"][-1])))
    for name in (RUN, RESULT) if documents else ():
        if name in source.documents:
            replace_file(target / name, source.documents[name])


def _check_ticks(ticks: dict[str, Array], path: Path) -> None:
    """Refuse implausible rows, or too few rows for the stated unit of time."""
    t = Ticks.of(pa.table(ticks), str(path)).t
    if len(t) < 2:
        raise ConfigurationError(f"{path}: holds {len(t)} rows of numbers, must hold two at least")
    if (apart := float(np.median(np.diff(t)))) > LONGEST_INTERVAL:
        raise ConfigurationError(
            f"{path}: t: rows are {apart:g} s apart, must be at most {LONGEST_INTERVAL:g} s; is "
            "`unit: ms` what the mapping should state?"
        )


def _header(name: str, how: MappingFile, index: int) -> dict[str, object]:
    place = how.runs.get(name, Place())
    header: dict[str, object] = {
        "schema": 1,
        "strip": how.strip,
        "start": how.start,
        "index": index if place.index is None else place.index,
        "contact_height": how.contact_height,
        "sigma": how.sigma.model_dump(exclude_unset=True),
    }
    if (condition := place.condition or how.condition) is not None:
        header["condition"] = condition
    return header | ({} if how.seen_by is None else {"seen_by": how.seen_by})


def _profile(source: Source, how: MappingFile, begin: float) -> dict[str, Array]:
    """Points of the strip; no rows where no profile was measured."""
    if how.profile is None:
        return {name: np.empty(0) for name in ("t", "i", "x", "z")}
    points = dict(read_columns(source, how.profile, how.profile.columns.items()))
    points["t"] = points["t"] - begin
    Profile.of(
        pa.table(points | {"i": np.zeros(len(points["t"]))}), str(path_of(source, how.profile))
    )
    if "i" not in points:  # numbered within each image, in the order of the file
        first = np.flatnonzero(np.diff(points["t"], prepend=np.nan))  # a NaN counts as a change
        sizes = np.diff(np.append(first, len(points["t"])))
        order = np.arange(len(points["t"])) - np.repeat(first, sizes)
        points["i"] = np.asarray(order, dtype=np.float64)
    return points


def _result(source: Source, how: MappingFile, begin: float, end: float) -> dict[str, object]:
    """Content of result.yaml: the touch, at most SOON after `end` [s] of the ticks, if any."""
    if how.result is None or not _touch_was_measured(source, how.result.file):
        return {"outcome": "path_done"}
    values = read_columns(source, how.result, how.result.columns.items())
    if not all(len(column) and np.isfinite(column).any() for column in values.values()):
        return {"outcome": "path_done"}
    path = path_of(source, how.result)
    if (rows := max(map(len, values.values()))) > 1:
        raise ConfigurationError(f"{path}: holds {rows} rows, must hold one: the first touch")
    found = {name: float(column[0]) for name, column in values.items()}
    found["t_layer_touch"] -= begin
    if not 0.0 <= (touch := found["t_layer_touch"]) <= end + SOON:
        raise ConfigurationError(
            f"{path}: t_layer_touch: is {touch:g} s after the first row of the gripper, whose last "
            f"is at {end:g} s; all tables of a run are on one clock"
        )
    found.setdefault("displacement", found["l1"] - found["l2"])
    return {"outcome": "layer_touch", **found}


def _touch_was_measured(source: Source, file: str) -> bool:
    """Whether the touch was measured: a folder without its file states that it was not."""
    return not isinstance(source, Folder) or (source.path / file).exists()
