"""Export of runs as a LeRobotDataset v3.0, a frame a tick, and import of such sets.

The data set's clock is nominal, `frame_index / fps`; the exact stamps are the feature
`stamp`, and those of the images `measured.contact_stamp` and `measured.profile_stamp`.
What belongs to the frame nearest to its image is NaN in all others: it stands under
`measured`, which no policy takes as its state. Where all runs were filmed, a frame has
the newest image, of `measured.camera_stamp`. `meta/cell.json` tells what is known of
each run: the geometry of its cell, its calibration and its result.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from cell.record.exchange.mapping import (
    MAPPING,
    TABLES,
    Source,
    Table,
    documents_of,
    mapping_of,
    stored_mapping,
)
from cell.record.files import FILM
from cell.record.film import Film, FilmWriter
from cell.record.run import Run
from cell.record.tables import place_rows, unnest, write_parquet
from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file
from drivers.base.readers import read_json, read_parquet
from drivers.base.types import Array, Frame
from drivers.base.yaml_text import parse_yaml

TASKS, STATS = "meta/tasks.parquet", "meta/stats.json"
TASK = "fold {} in half"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
FORMAT_VERSION = "v3.0"
CAMERA, CAMERA_STAMP = "observation.images.camera", "measured.camera_stamp"
SAMPLE = 8  # px between those that the statistics of images are of
VECTORS = {
    "observation.state": ("x", "z", "pitch"),
    "action": ("x_cmd", "z_cmd", "pitch_cmd", "hand_cmd"),
    "measured.force": ("f_x", "f_z"),
}
INFO = "meta/info.json"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
PLACE = re.compile(r"\{(chunk_index|file_index|video_key)(?::0(\d)d)?\}")
EPISODE = "episode"  # its tables, as a mapping names them
POINTS_TABLE, POINTS_STAMP = "points", "measured.profile_stamp"
MEASURED = re.compile(r"observation\.(?=contact|profile_|camera_stamp)")  # of old sets
STATISTICS: dict[str, Callable[[Array], Any]]
STATISTICS = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}
STATISTICS |= {f"q{p:02d}": partial(np.percentile, q=p) for p in (1, 10, 50, 90, 99)}
# 1 had actions without pitch and hand, 2 a choice of what is known of a run
ABOUT, ABOUT_VERSION = "meta/cell.json", 3


class Feature(NamedTuple):
    """Values of one quantity in the frames of a LeRobot data set, a number or a row of
    numbers for each frame, and names of the numbers in a row.
    """

    values: Any
    names: list[str] | None = None

    @property
    def size(self) -> int:
        """How many numbers the feature has in each frame."""
        return 1 if self.values.ndim == 1 else self.values.shape[1]

    def stated(self) -> dict[str, Any]:
        """Description of the feature as the file meta/info.json of a data
        set holds it.
        """
        kind, shape = str(self.values.dtype), [self.size]
        return {"dtype": kind, "shape": shape, "names": self.names}


def write_lerobot(runs: Sequence[Run], out: Path) -> tuple[Path, ...]:
    """Write `runs` as one LeRobot data set into the new folder `out`, and return that
    folder as a tuple of one.

    Raises ConfigurationError where their films have images of several sizes.
    """
    begin, fps = 0, _rate(runs)
    rows: list[dict[str, Any]] = []
    frames: list[dict[str, Feature]] = []
    tasks = list(dict.fromkeys(TASK.format(run.header.strip) for run in runs))
    for i, run in enumerate(runs):
        count = len(run.ticks.t)
        rows.append(_episode_row(run, i, begin, count))
        counters = _counters(i, begin, count, fps, tasks.index(rows[-1]["tasks"][0]))
        frames.append(_features(run, runs) | counters)
        _write(out / _fill_pattern(DATA, 0, i), _table(frames[-1]))
        begin += count

    stats, info = _stats(frames), _info(runs, frames[0], begin, len(tasks))
    if CAMERA_STAMP in frames[0]:
        info["features"][CAMERA], stats[CAMERA] = _write_films(runs, rows, out, fps)

    episodes = {name: [row[name] for row in rows] for name in rows[0]}
    _write(out / _fill_pattern(EPISODES, 0, 0), pa.table(episodes))
    _write(out / TASKS, _tasks(tasks))
    replace_file(out / STATS, json.dumps(stats).encode())
    replace_file(out / INFO, json.dumps(info).encode())
    replace_file(out / ABOUT, json.dumps(_about(runs)).encode())
    # the touch is in the documents
    mapping = mapping_of(runs, _file_and_column, TABLES[:3])
    replace_file(out / "meta" / MAPPING, mapping)
    return (out,)


def _about(runs: Sequence[Run]) -> dict[str, Any]:
    """Content of the file meta/cell.json of an exported data set, which holds the YAML
    documents of each run.
    """
    found = {
        run.name: {
            name: parse_yaml(content.decode(), name)
            for name, content in documents_of(run).items()
            if content
        }
        for run in runs
    }
    return {"format": "folding-cell lerobot", "version": ABOUT_VERSION, "runs": found}


def _write_films(
    runs: Sequence[Run], rows: Sequence[dict[str, Any]], out: Path, fps: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Write a film for each of `runs` below the folder `out`, and add where it lies to
    the entry of that run in `rows`.

    Returns the images as a feature of meta/info.json, and statistics of their pixels.
    Raises ConfigurationError for films with images of several sizes.
    """
    film = f"videos/{CAMERA}"
    samples: list[Mapping[str, Feature]] = []
    first: tuple[int, ...] = ()
    for i, (run, row) in enumerate(zip(runs, rows, strict=True)):
        path = out / _fill_pattern(VIDEO, 0, i, CAMERA)
        shape, sample = _write_film(run, path, fps)
        first = first or shape
        if shape != first:
            raise ConfigurationError(
                f"{run.folder / FILM}: its images have another size than those of "
                f"{runs[0].folder}; export these runs apart"
            )
        samples.append({CAMERA: sample})
        row.update(_place(film, i))
        row[f"{film}/from_timestamp"] = 0.0
        row[f"{film}/to_timestamp"] = row["length"] / fps
    stats = {
        name: values if name == "count" else [[[value]] for value in values]
        for name, values in _stats(samples)[CAMERA].items()
    }
    names = ["height", "width", "channels"]
    return {"dtype": "video", "shape": list(first), "names": names}, stats


def _file_and_column(table: str, column: str) -> tuple[str, str]:
    """File and column of a data set that hold the `column` of the `table` of an
    exported run.
    """
    if table == "contact":
        stamp = "measured.contact_stamp"
        return EPISODE, stamp if column == "t" else "measured.contact"
    if table != "ticks":
        return POINTS_TABLE, column
    for feature, names in VECTORS.items():
        if column in names:
            return EPISODE, f"{feature}.{column}"
    return EPISODE, "stamp"


def _features(run: Run, runs: Sequence[Run]) -> dict[str, Feature]:
    """Features of all frames of `run`, with only those columns of motion that all
    `runs` have.
    """
    found: dict[str, Feature] = {}
    ticks = run.tables()["ticks"]
    shared = set.intersection(*({*other.tables()["ticks"]} for other in runs))
    for name, columns in VECTORS.items():
        there = [column for column in columns if column in shared]
        if there:
            vectors = np.column_stack([ticks[column] for column in there])
            found[name] = Feature(vectors, there)
    found["stamp"] = Feature(ticks["t"])

    if any(len(other.ticks.contacts()[0]) for other in runs):
        stamps, contacts = run.ticks.contacts()
        found["measured.contact"] = _at_frames(run, stamps, contacts)
        found["measured.contact_stamp"] = _at_frames(run, stamps, stamps)
    if all(other.film_stamps() for other in runs):
        shown = run.film_stamps()
        newest = [shown[number] for number in _newest_images(run)]
        found[CAMERA_STAMP] = Feature(np.array(newest))

    curves = [curve for other in runs for _, curve in other.profile.curves()]
    points = max(map(len, curves), default=0)
    return found | (_curves(run, points) if points else {})


def _curves(run: Run, points: int) -> dict[str, Feature]:
    """Features with the measured midlines of the strip, of up to `points` points, each
    in the frame that is nearest to its image.
    """
    curves = run.profile.curves()
    stamps = np.array([stamp for stamp, _ in curves])
    padded = np.full((len(curves), points, 2), np.nan)
    for row, (_, curve) in zip(padded, curves, strict=True):
        row[: len(curve)] = curve
    names = list(map(str, range(points)))
    x, z = (
        _at_frames(run, stamps, padded[..., axis])._replace(names=names)
        for axis in (0, 1)
    )
    found = {"measured.profile_x": x, "measured.profile_z": z}
    return {POINTS_STAMP: _at_frames(run, stamps, stamps)} | found


def _at_frames(run: Run, stamps: Array, values: Array) -> Feature:
    """Feature with one row of `values` in the frame nearest to each of the times
    `stamps` [s], and NaN in all other frames.
    """
    t = run.ticks.t
    rows = place_rows(t, stamps)
    if len(np.unique(rows)) < len(rows):
        raise ConfigurationError(
            f"{run.folder}: two images belong to one row of ticks.parquet; LeRobot"
            " keeps one a frame: export it as mcap or csv"
        )
    found = np.full((len(t), *values.shape[1:]), np.nan)
    found[rows] = values
    return Feature(found)


def _newest_images(run: Run) -> list[int]:
    """For each row of a run, the number in its film of the newest image at that time,
    or of the first image where there is none yet.
    """
    stamps = run.film_stamps()
    newest = np.searchsorted(list(stamps.values()), run.ticks.t, side="right") - 1
    numbers = list(stamps)
    return [numbers[image] for image in np.maximum(newest, 0)]


def _write_film(run: Run, path: Path, fps: int) -> tuple[tuple[int, ...], Feature]:
    """Write the film of a run anew at `path` with one image for each row; returns the
    shape of the images, and some pixels.

    Raises ConfigurationError for a run whose film breaks off.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    rows_of_image = Counter(_newest_images(run))
    row = 0
    sample: list[Array] = []
    shape: tuple[int, ...] = ()
    with FilmWriter(path) as film:
        for number, frame in enumerate(Film(run.folder / FILM).frames()):
            for _ in range(rows_of_image[number]):
                film.add(row / fps, frame.image)
                row += 1
            if rows_of_image[number]:
                shape = frame.image.shape
                pixels = frame.image[::SAMPLE, ::SAMPLE, ::-1]  # BGR to RGB
                sample.append(pixels.reshape(-1, 3) / 255)
    if row < rows_of_image.total():
        raise ConfigurationError(
            f"{run.folder / FILM}: breaks off before the run's end; delete it to export"
            " without a film"
        )
    return shape, Feature(np.concatenate(sample))


def _place(kind: str, number: int) -> dict[str, int]:
    """Columns of the file meta/episodes that say which file, by its `number`, holds the
    data or film of an episode.
    """
    return {f"{kind}/chunk_index": 0, f"{kind}/file_index": number}


def _counters(
    episode: int, begin: int, count: int, fps: int, task: int
) -> dict[str, Feature]:
    frame = np.arange(count)
    found = {"timestamp": (frame / fps).astype(np.float32), "frame_index": frame}
    found |= {"episode_index": np.full(count, episode), "index": begin + frame}
    found |= {"task_index": np.full(count, task)}
    return {name: Feature(values) for name, values in found.items()}


def _table(features: Mapping[str, Feature]) -> pa.Table:
    """Arrow table of all frames: a column of numbers for each feature, or of lists of
    fixed size where it has several numbers in a frame.
    """
    columns = {}
    for name, feature in features.items():
        column = pa.array(feature.values.ravel())
        if feature.size > 1:
            column = pa.FixedSizeListArray.from_arrays(column, feature.size)
        columns[name] = column
    return pa.table(columns)


def _episode_row(run: Run, i: int, begin: int, count: int) -> dict[str, Any]:
    """Row of the file meta/episodes for one run, which also holds the run's YAML
    documents.
    """
    documents = documents_of(run).items()
    return {
        "episode_index": i,
        "tasks": [TASK.format(run.header.strip)],
        "length": count,
        **_place("data", i),
        "dataset_from_index": begin,
        "dataset_to_index": begin + count,
        **_place("meta/episodes", 0),
        "cell/name": run.name,
        **{f"cell/{name}": content.decode() for name, content in documents},
    }


def _tasks(tasks: Sequence[str]) -> pa.Table:
    """Table of the texts of all tasks with their numbers, which pandas reads with the
    text as the index.
    """
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    keys = ("name", "field_name", "pandas_type", "numpy_type", "metadata")
    columns = [
        dict(zip(keys, (name, name, *kind, None), strict=True))
        for name, kind in kinds.items()
    ]
    stated = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    table = pa.table(
        {"task_index": pa.array(range(len(tasks)), pa.int64()), "task": tasks}
    )
    return table.replace_schema_metadata({"pandas": json.dumps(stated)})


def _stats(each: Sequence[Mapping[str, Feature]]) -> dict[str, Any]:
    """Statistics of each feature over all values that were measured, such as mean and
    range, and their number.
    """
    found = {}
    for name, feature in each[0].items():
        rows = np.concatenate([features[name].values for features in each])
        columns = rows.reshape(len(rows), feature.size).T
        measured = [column[np.isfinite(column)] for column in columns]
        known = [column if len(column) else np.zeros(1) for column in measured]
        found[name] = {
            statistic: [float(of(column)) for column in known]
            for statistic, of in STATISTICS.items()
        }
        found[name]["count"] = [max(map(len, measured))]
    return found


def _info(
    runs: Sequence[Run], features: Mapping[str, Feature], frames: int, tasks: int
) -> dict[str, Any]:
    """Content of the file meta/info.json of a data set that holds `runs` with the given
    `features`.
    """
    drivers = runs[0].header.drivers
    return {
        "codebase_version": FORMAT_VERSION,
        "robot_type": "unknown" if drivers is None or not drivers.arm else drivers.arm,
        "total_episodes": len(runs),
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": len(runs),
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": _rate(runs),
        "splits": {"train": f"0:{len(runs)}"},
        "data_path": DATA,
        "video_path": VIDEO,
        "features": {name: feature.stated() for name, feature in features.items()},
    }


def _rate(runs: Sequence[Run]) -> int:
    """Typical number of rows per second in `runs`, rounded [Hz]."""
    steps = np.concatenate([np.diff(run.ticks.t) for run in runs])
    return max(round(1.0 / float(np.median(steps))), 1) if len(steps) else 1


def _fill_pattern(pattern: str, chunk: int, file: int, camera: str = "") -> str:
    """Path of a file in a data set, from the `pattern` in meta/info.json and the
    numbers of the chunk, the file and the camera.
    """
    numbers = {"chunk_index": str(chunk), "file_index": str(file), "video_key": camera}
    return PLACE.sub(lambda found: numbers[found[1]].zfill(int(found[2] or 0)), pattern)


def _write(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_parquet(path, table)


@dataclass
class Episode(Source):
    """Episode of a LeRobot data set as a run to be imported: a table of its frames,
    perhaps one of the strip's points, and perhaps a film.

    The table `episode` holds the frames, with a column for each component of a vector;
    `points` are those of the strip in an exported run. The episode begins at `begin`
    [s] of its `film`.
    """

    frames: pa.Table
    film: Path | None
    begin: float
    info: Mapping[str, Any]

    def images(self) -> Iterator[tuple[int, Frame]]:
        """Yield the images of the episode's film, each of them once, with the number of
        the frame to which it belongs.
        """
        table, begin = self.frames, self.begin
        count = len(table)
        rows = set(range(count))
        if CAMERA_STAMP in table.column_names:
            taken = np.unique(table[CAMERA_STAMP].to_numpy())
            rows = set(np.searchsorted(table["stamp"].to_numpy(), taken).tolist())
        for frame in Film(self.film).frames(begin) if self.film else ():
            row = round((frame.stamp - begin) * float(self.info["fps"]))
            if row >= count:
                return
            if row in rows:
                yield row, frame

    def table(self, how: Table[Any]) -> pa.Table:
        """Table of the episode's frames or of the strip's points, whichever `how`
        names; ConfigurationError for any other table.
        """
        if how.file not in self.names:
            raise self.missing(how)
        if how.file == POINTS_TABLE:
            return self._points()
        vectors = {
            name: feature.get("names")
            for name, feature in self.info["features"].items()
        }
        return unnest(self.frames, str(self.path), vectors)

    def _points(self) -> pa.Table:
        """Table of the measured points on the strip: time [s], number of the point, and
        x and z [m].
        """
        shape = (len(self.frames), -1)
        x, z = (
            np.reshape(self.frames[f"measured.profile_{axis}"].to_pylist(), shape)
            for axis in "xz"
        )
        row, i = np.nonzero(np.isfinite(x))
        stamp = self.frames[POINTS_STAMP].to_numpy()
        return pa.table({"t": stamp[row], "i": i, "x": x[row, i], "z": z[row, i]})


def episodes(root: Path) -> Iterator[Episode]:
    """Yield the episodes of the LeRobot data set in the folder `root`, each with its
    own frames alone.

    Raises ConfigurationError for a data set of another version, or a broken one.
    """
    info = read_json(root / INFO)
    if not str(info.get("codebase_version", "")).startswith("v3."):
        raise ConfigurationError(
            f"{root / INFO}: codebase_version: is {info.get('codebase_version')!r},"
            " must be v3.x; convert it with LeRobot's own script"
        )
    features = info.get("features")
    if not (
        isinstance(features, dict)
        and all(isinstance(f, dict) for f in features.values())
    ):
        raise ConfigurationError(
            f"{root / INFO}: features: must map each name to a description"
        )
    read = lru_cache(maxsize=1)(read_parquet)  # a file holds many episodes
    for path in sorted((root / "meta" / "episodes").glob("*/*.parquet")):
        for row in read_parquet(path).to_pylist():
            try:
                yield _read_episode(root, info, row, read)
            except (KeyError, TypeError, ValueError) as error:
                raise ConfigurationError(
                    f"{path}: a row is not whole: {error}"
                ) from None


def _read_episode(
    root: Path,
    info: Mapping[str, Any],
    row: Mapping[str, Any],
    read: Callable[[Path], pa.Table],
) -> Episode:
    """Episode that the `row` of the file meta/episodes describes; errors such as
    KeyError where the row is broken.
    """
    path = _path_in_set(root, info.get("data_path") or DATA, "data", row)
    name = str(row.get("cell/name") or f"episode-{row['episode_index']:06d}")
    if name == ".." or Path(name).name != name:
        raise ValueError(f"cell/name: {name!r} is not the name of a folder")
    documents = stored_mapping(root / "meta" / MAPPING)
    for key, value in row.items():
        if key.startswith("cell/") and value:
            documents[key.removeprefix("cell/")] = str(value).encode()

    frames = read(path).filter(pc.field("episode_index") == row["episode_index"])
    columns = [MEASURED.sub("measured.", column) for column in frames.column_names]
    frames = frames.rename_columns(columns)
    tables = [EPISODE]
    if POINTS_STAMP in columns:
        tables.append(POINTS_TABLE)

    film, begin = None, 0.0
    camera = _first_camera(info, row)
    if camera is not None:
        film = _path_in_set(root, info.get("video_path") or VIDEO, camera, row)
        begin = float(row[f"{camera}/from_timestamp"])
    return Episode(path, name, documents, tables, frames, film, begin, info)


def _first_camera(info: Mapping[str, Any], row: Mapping[str, Any]) -> str | None:
    """Key of the first camera that has filmed the episode of `row`, as `videos/NAME`;
    None where no camera has.
    """
    for name, feature in info["features"].items():
        key = f"videos/{name}"
        if feature.get("dtype") == "video" and f"{key}/file_index" in row:
            return key
    return None


def _path_in_set(root: Path, pattern: str, key: str, row: Mapping[str, Any]) -> Path:
    """Path of the data or the film of an episode, as `key` says; ConfigurationError
    where it does not lie in the data set.
    """
    kind, _, camera = key.partition("s/")
    path = _fill_pattern(
        pattern, row[f"{key}/chunk_index"], row[f"{key}/file_index"], camera
    )
    if Path(path).is_absolute() or ".." in Path(path).parts:
        raise ConfigurationError(
            f"{root / INFO}: {kind}_path: {path!r} leads out of the data set; give a"
            " path in it"
        )
    return root / path
