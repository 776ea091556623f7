"""Import of measured runs: foreign tables are checked, converted, written as run
folders.
"""

import re
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from itertools import chain, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa

from cell.record.columns import ANGLES, LENGTHS, TIMES, check_order
from cell.record.documents import write_document
from cell.record.exchange.lerobot import INFO, episodes
from cell.record.exchange.mapping import (
    FILE,
    MAPPING,
    OF_SIGNALS,
    TABLES,
    MappingFile,
    RunFacts,
    SignalMapping,
    Source,
    TableFiles,
    TickColumn,
    read_columns,
)
from cell.record.files import PROFILE, RESULT, RUN, SIGNALS, TICKS, is_run, runs_in
from cell.record.frames import FrameWriter
from cell.record.run import read_run
from cell.record.tables import (
    TooLarge,
    check_clock,
    place_contacts,
    place_rows,
    write_parquet,
)
from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.extras import require_library
from drivers.base.files import (
    check_free,
    lock_folders,
    move_folder,
    replace_file,
    scratch_folder,
    write_file,
    writing,
)
from drivers.base.settings import load, parse
from drivers.base.types import Array
from drivers.base.yaml_text import dump_yaml, parse_yaml

AnyMapping = MappingFile | SignalMapping
Content = Mapping[str, Any]
Check = Callable[[Path], object]
LengthOf = Callable[[str], float]
BAG = "metadata.yaml"  # of a folder that rosbag2 recorded
COMPLETE = "complete"  # mark in a scratch folder all of whose runs are written
ALREADY = "is a run already; `cell gap fit` takes it as it is"
READ = re.compile(rf"{FILE.pattern}|.+\.mcap")  # files of a run
CHANGED_TOGETHER = (("ticks", "contact"), *zip(TABLES[1:], strict=True), TABLES)
"""Tables of a fold in whose columns a mistake in its mapping is looked for at once."""


def import_runs(
    paths: Sequence[Path],
    mapping: Path | None,
    out: Path,
    check: Check = read_run,
    kind: type[AnyMapping] = MappingFile,
    length: LengthOf | None = None,
    tell: Callable[[str], object] = str,
) -> tuple[Path, ...]:
    """Import the runs of other programs in `paths`, in this order, and return the new
    folders below `out` that hold them.

    A place is a folder of tables, a folder of such folders, a table, an MCAP file, or a
    LeRobot data set; what `cell export` wrote brings its own mapping. All runs are
    written, or none. `check` reads each of them; `kind` is that of the mapping, of
    folds or of a mechanism; `length` [m] is that of a strip by its name, for the
    mending of a mapping; `tell` is called with each remark on what was passed over.
    Raises ConfigurationError for tables that are missing or do
    not hold what `mapping` says, values that no run can have, or a run that is there
    already.
    """
    stated = None if mapping is None else load(mapping, kind)
    files = {table.file for table in stated.tables.values()} if stated else ()
    sources = chain.from_iterable(sources_in(path, mapping, files) for path in paths)
    with scratch_folder(out) as scratch:
        for run in _complete_killed(out):
            tell(f"{run}: its import was killed at the end, and is completed now")
        made: list[Path] = []
        for index, source in enumerate(sources):
            how = stated or _exported_mapping(source, kind)
            run = scratch / source.name
            check_free(out / run.name)
            if run in made:
                raise ConfigurationError(
                    f"{source.path}: is the second run named {run.name}; rename one"
                )
            made.append(run)
            try:
                with writing(out):
                    write_run(source, how, index, run)
                    # a fold's own documents
                    if stated is None and (run / RESULT).is_file():
                        for name in source.documents.keys() & {RUN, RESULT}:
                            replace_file(run / name, source.documents[name])
                check(run)
            except TooLarge:
                raise
            except ConfigurationError as error:
                fault = _in_words_of_source(str(error), source, how, run)
                remedy = _remedy(source, how, check, run, length)
                raise ConfigurationError(fault + remedy) from None
            for remark in dict.fromkeys(source.remarks):
                tell(remark)
            with writing(out):
                _write_film(source, run)
        if not made:
            raise ConfigurationError(f"{paths[0]}: holds no tables")
        return _move_all(scratch, made, out)


def _in_words_of_source(text: str, source: Source, how: AnyMapping, run: Path) -> str:
    """The `text` of an error about the new folder `run`, with the names of its files
    replaced by those of the `source` that they come from.
    """
    for file, table in how.tables.items():
        mapped = ", as mapped" if file == SIGNALS else ""
        text = text.replace(str(run / file), f"{source.place(table)}{mapped}")
    return text.replace(str(run), str(source.path))


def _move_all(scratch: Path, made: Sequence[Path], out: Path) -> tuple[Path, ...]:
    """Move the folders `made` from the folder `scratch` into `out`, all of them or
    none, and return their new paths.

    The rest of a move that is killed is found by its mark, COMPLETE.
    """
    moved = {run: out / run.name for run in made}
    mark = scratch / COMPLETE
    with lock_folders([out]):
        write_file(mark, b"")
        try:
            for run, place in moved.items():
                move_folder(run, place)
        except BaseException:
            for run, place in moved.items():
                if not run.exists():
                    shutil.rmtree(place, ignore_errors=True)
            raise
        finally:
            mark.unlink()
    return tuple(moved.values())


def _complete_killed(out: Path) -> Iterator[Path]:
    """Move runs to the folder `out` whose import was killed after the runs were whole
    but before all of them were moved, and yield their new paths.
    """
    with lock_folders([out]):
        for mark in [*out.glob(f".*.part/{COMPLETE}")]:
            for run in runs_in(mark.parent):
                place = out / run.name
                move_folder(run, place)
                yield place
            shutil.rmtree(mark.parent, ignore_errors=True)


def _remedy(
    source: Source, how: AnyMapping, check: Check, run: Path, length: LengthOf | None
) -> str:
    """Text of the first change of the mapping that makes the imported fold `run`
    plausible, or else of what to try; empty where there is no advice.
    """
    if not isinstance(how, MappingFile):
        return ""
    tried: list[object] = []
    for (change, quantities), tables in product(
        _changes(source, how, length), CHANGED_TOGETHER
    ):
        mapping, changed = _with_change(how, change, quantities, tables)
        if not changed or (change, changed) in tried:
            continue
        tried.append((change, changed))
        with (
            suppress(ConfigurationError, ValueError),
            TemporaryDirectory(dir=run.parent) as folder,
        ):
            mended = Path(folder) / source.name
            write_run(source, MappingFile.model_validate(mapping), 0, mended)
            check(mended)
            remedy = (
                ", ".join(dump_yaml(change).splitlines())
                if change
                else "swapped columns"
            )
            parts = [
                " and ".join(dict.fromkeys(part)) for part in zip(*changed, strict=True)
            ]
            return f"; {remedy} for {' of '.join(parts)} in the mapping would mend it"
    return "; `cell import --guess` proposes a mapping" if (run / RUN).is_file() else ""


def _changes(
    source: Source, how: MappingFile, length: LengthOf | None
) -> Iterator[tuple[Content, tuple[str, ...]]]:
    """Yield changes of a mapping that may mend it, such as another unit or sign, each
    with the names of the columns that it changes.
    """
    x, z, pitch = ("x", "contact_x"), ("z",), ("pitch",)
    positions = (x, z, (*x, *z))
    tries: tuple[tuple[str, Collection[object], tuple[tuple[str, ...], ...]], ...] = (
        ("reversed", (True, False), (*positions, pitch)),
        ("unit", ANGLES, (pitch,)),
        ("unit", LENGTHS, (*positions, ("l1", "l2"))),
        ("unit", TIMES, (("t", "t_layer_touch"),)),
    )
    for key, values, quantities in tries:
        yield from product([{key: value} for value in values], quantities)
    yield {}, ("x", "z")
    if length is None:
        return
    with suppress(ConfigurationError, IndexError):  # no row
        starts: dict[TickColumn, float] = {"x": length(how.strip), "z": 0.0}
        for name, start in starts.items():
            yield from product(
                _zeros(source, how, name, start), ((name, f"contact_{name}"),)
            )


def _with_change(
    how: MappingFile, change: Content, quantities: Sequence[str], tables: Sequence[str]
) -> tuple[Content, list[tuple[str, str]]]:
    """Copy of the mapping `how` with `change` made in the named columns of `tables`,
    and a list of the columns that it concerns.
    """
    content = how.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)
    changed = []
    for name in tables:
        if (table := content.get(name)) is None:
            continue
        columns = table["columns"]
        present = [quantity for quantity in quantities if quantity in columns]
        if not change and {"x", "z"} <= columns.keys():
            columns["x"], columns["z"] = columns["z"], columns["x"]
        for quantity in present:
            columns[quantity].update(change)
        changed += [(quantity, f"{name} ({table['file']})") for quantity in present]
    return content, changed


def _zeros(
    source: Source, how: MappingFile, name: TickColumn, start: float
) -> list[Content]:
    """Two changes of a mapping that let the gripper's x or z, whichever `name` says,
    begin at `start` [m]: one with its axis reversed, one without.
    """
    column = how.ticks.columns[name]
    first = float(read_columns(source, how.ticks)[name][0])
    # [m], of the foreign zero
    raw = column.offset + (-first if column.reversed else first)
    zeros = ((True, raw + start), (False, raw - start))
    return [
        {"reversed": turned, "offset": round(offset, 3) + 0.0}
        for turned, offset in zeros
    ]


def sources_in(
    path: Path, mapping: Path | None = None, files: Collection[str] = ()
) -> Iterator[Source]:
    """Yield the runs of other programs that lie at or in `path`, whatever their format;
    none for the mapping file itself.

    `files` are those that the mapping reads, if known. Raises ConfigurationError for
    what holds none.
    """
    parts = sorted(path.glob("*.mcap"))
    is_file = path.is_file()
    if (is_file and path.suffix == ".mcap") or (path / BAG).is_file():
        yield _recording(path, parts)
    elif parts:
        yield from (_recording(part, ()) for part in parts)
    elif (path / INFO).is_file():
        yield from episodes(path)
    elif path.is_dir():
        yield from _sources_in_folder(path, files)
    elif is_file and FILE.fullmatch(path.name):
        yield TableFiles(path)
    elif not (is_file and (path.name == MAPPING or path == mapping)):
        fault = "is none of what is read" if path.exists() else "is not there"
        raise ConfigurationError(
            f"{path}: {fault}; give tables or folders with them, .mcap files or"
            " LeRobot data sets"
        )


def _recording(path: Path, parts: Sequence[Path]) -> Source:
    """Run in the MCAP file at `path`, or in the MCAP files `parts` of the ROS 2
    recording whose folder `path` is.
    """
    require_library("mcap")
    from cell.record.exchange.mcap_file import McapFile

    if path.is_dir() and not parts:
        raise ConfigurationError(
            f"{path}: is a rosbag2 folder without an .mcap file; convert it:"
            " `ros2 bag convert` with `storage_id: mcap`"
        )
    return McapFile(path, parts)


def _sources_in_folder(place: Path, files: Collection[str]) -> Iterator[Source]:
    """Yield the runs in the folders below `place` that hold tables, or the one run
    whose tables lie in `place` itself.

    Tables beside such folders are passed over with a remark, unless the mapping reads
    `files` of their names, or nothing is known of these.
    """
    content = sorted(place.iterdir())
    own = [path.name for path in content if FILE.fullmatch(path.name)]
    meant = {*own} & {*files} if files else [n for n in own if not n.endswith(".txt")]
    folders = [path for path in content if path.is_dir()]
    if own and (meant or not any(map(_holds_tables, folders))):
        yield TableFiles(place)
        return
    if not folders:
        fault = "holds no tables; give a folder with CSV or Parquet"
        raise ConfigurationError(f"{place}: {ALREADY if is_run(place) else fault}")
    for folder in folders:
        for source in sources_in(folder, files=files):
            source.remarks += [
                f"{place / n}: is no run, and is passed over" for n in own
            ]
            own = []
            yield source


def _holds_tables(folder: Path) -> bool:
    return any(READ.fullmatch(path.name) for path in folder.iterdir())


def _exported_mapping(source: Source, kind: type[AnyMapping]) -> AnyMapping:
    """Mapping of the class `kind` that an export has put beside the tables of `source`;
    ConfigurationError where there is none.
    """
    content = source.documents.get(MAPPING)
    if content is None:
        fault = (
            "nothing says which column holds what; give --mapping: --guess proposes one"
        )
        if is_run(source.path):
            fault = ALREADY
        raise ConfigurationError(f"{source.path}: {fault}")
    origin = f"{source.path}: {MAPPING}"
    return parse(parse_yaml(content.decode(errors="replace"), origin), kind, origin)


def write_run(source: Source, how: AnyMapping, index: int, target: Path) -> None:
    """Write the tables of `source`, converted as the mapping `how` says, as a run in
    the new folder `target`.
    """
    stated = how.runs.get(source.name, RunFacts()).model_dump(exclude_none=True)
    common = {} if how.condition is None else {"condition": how.condition}
    facts = {"index": index} | common | stated  # by default that of the call
    made: dict[str, Content]
    if isinstance(how, SignalMapping):
        run = {"schema": 1, "mechanism": how.mechanism, **facts}
        made = {RUN: run, SIGNALS: _signals(source, how)}
    else:
        made = _fold(source, how, facts)
    target.mkdir()
    for name, content in made.items():
        if name in {RUN, RESULT}:
            write_document(target / name, content)
        else:
            write_parquet(target / name, pa.table(content))


def _signals(source: Source, how: SignalMapping) -> dict[str, Array]:
    """Columns of a mechanism's signals by name, each with a value for each time in the
    first table of the mapping `how`.

    A reading of another table is interpolated at the row nearest to it, NaN in others.
    """
    first, *others = how.signals
    found = dict(read_columns(source, first, OF_SIGNALS))
    for table in others:
        columns = dict(read_columns(source, table, OF_SIGNALS))
        t, stamps = found["t"], columns.pop("t")
        origin = f"{source.path}: {table.file}"
        check_order(stamps, origin)
        inside = stamps[(stamps >= t[:1]) & (stamps <= t[-1:])]
        if inside.size < 2 or t.size < 2:
            raise ConfigurationError(
                f"{origin}: t: shares no time with {first.file}; give all times of a"
                " run in s on one clock"
            )
        rows = np.unique(place_rows(t, inside))
        for name, values in columns.items():
            found[name] = np.full(t.size, np.nan)
            found[name][rows] = np.interp(t[rows], stamps, values, np.nan, np.nan)
    return found


def _fold(source: Source, how: MappingFile, facts: Content) -> dict[str, Content]:
    """Content of the files of an imported fold, by file name: header, gripper's motion,
    midlines and result.
    """
    ticks = dict(read_columns(source, how.ticks))
    begin = how.begin
    if begin is None:
        begin = next(iter(ticks["t"][:1].tolist()), 0.0)
    ticks |= {name: ticks[name] - begin for name in ("t", "contact_t") if name in ticks}
    t = ticks["t"]
    if contact := how.contact:
        seen = read_columns(source, contact)
        stamps = seen["t"] - begin
        check_clock(stamps, t, f"{source.place(contact)}: t")
        placed = place_contacts(t, stamps, seen["contact_x"])
        ticks |= dict(zip(("contact_x", "contact_t"), placed, strict=True))
    of_run = {"strip", "start", "contact_height", "sigma", "seen_by"}
    return {
        RUN: {
            "schema": 1,
            **how.model_dump(include=of_run, exclude_unset=True),
            **facts,
        },
        TICKS: ticks,
        PROFILE: _profile(source, how, begin, t),
        RESULT: _result(source, how, begin, t),
    }


def _write_film(source: Source, run: Path) -> None:
    """Write the images of `source`, if it has any, as the film of the imported fold in
    the folder `run`.
    """
    images = iter(source.images())
    first = next(images, None)
    if first is None or not (run / TICKS).is_file():  # no image shows a mechanism
        return
    t = read_run(run).ticks.t.tolist()
    with closing(FrameWriter(run, "key", patient=True, encoder="libx264")) as writer:
        for row, frame in chain([first], images):
            writer.put(
                replace(frame, stamp=t[row], arrival=t[row], sequence=row), mark=False
            )


def _profile(
    source: Source, how: MappingFile, begin: float, t: Array
) -> dict[str, Array]:
    """Columns of the points on the strip, by name: time [s], number of the point, and x
    and z [m]; empty where none were measured.
    """
    profile = how.profile
    if profile is None:
        return {name: np.empty(0) for name in ("t", "i", "x", "z")}
    points = dict(read_columns(source, profile))
    stamps = points["t"] = points["t"] - begin
    check_clock(stamps, t, f"{source.place(profile)}: t")
    if "i" not in points:  # numbered within each image, in the order of the file
        rows = np.arange(len(stamps), dtype=np.float64)
        begins = np.diff(stamps, prepend=np.nan) != 0.0  # a NaN counts as a change
        points["i"] = rows - np.maximum.accumulate(np.where(begins, rows, 0.0))
    return points


def _result(
    source: Source, how: MappingFile, begin: float, t: Array
) -> dict[str, object]:
    """Content of the result file of an imported fold: its outcome and, if it was
    measured, the touch of the layers, with times from `begin` [s] on.

    Raises ConfigurationError for a missing file, where another's name is close to its
    name.
    """
    result = how.result
    if result is None:
        return {"outcome": "path_done"}
    used = {
        source.place(each).name
        for each in (how.ticks, how.profile, how.contact)
        if each
    }
    path, values = source.place(result), {}
    if path.exists():
        values = read_columns(source, result)
    elif suggestion(result.file, {*source.names} - used):
        raise source.missing(result)
    if not (values and all(np.isfinite(v).any() for v in values.values())):
        return {"outcome": "path_done"}  # no touch
    if (rows := max(map(len, values.values()))) > 1:
        raise ConfigurationError(
            f"{path}: holds {rows} rows, must hold one: the first touch"
        )
    found = {name: float(column[0]) for name, column in values.items()}
    found["t_layer_touch"] -= begin
    check_clock(np.array([found["t_layer_touch"]]), t, f"{path}: t_layer_touch")
    found.setdefault("displacement", found["l1"] - found["l2"])
    return {"outcome": "layer_touch", **found}
