"""Reading of episodes of a LeRobotDataset v3.0, whoever recorded them, as sources of tables."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cell.record.exchange.mapping import MAPPING
from cell.record.files import RESULT, RUN
from drivers.errors import ConfigurationError, suggestion
from drivers.readers import MEGABYTE, read_bytes, read_json, read_parquet
from drivers.types import Array

INFO = "meta/info.json"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODE = "episode"  # its tables, as a mapping names them
POINTS_TABLE = "points"
TOUCH = "touch"


@dataclass(frozen=True, slots=True)
class Episode:
    """An episode as a source of tables: `episode`, and of an exported run `points` and `touch`.

    The table `episode` holds the frames, with a column for each component of a vector.
    """

    path: Path
    name: str
    documents: Mapping[str, bytes]
    frames: pa.Table
    features: Mapping[str, Any]
    result: Mapping[str, float]

    def table(self, file: str, _how: object) -> pa.Table:
        """Frames, points or touch of the episode; ConfigurationError for any other table."""
        if file == EPISODE:
            return self._flat()
        if file == POINTS_TABLE and "observation.profile_stamp" in self.frames.column_names:
            return self._points()
        if file == TOUCH:
            return pa.table({name: [value] for name, value in self.result.items()})
        known = (EPISODE, POINTS_TABLE, TOUCH)
        raise ConfigurationError(
            f"{self.path}: file {file!r} is not there{suggestion(file, known)}; "
            f"allowed: {', '.join(known)}"
        )

    def _flat(self) -> pa.Table:
        columns = {}
        for name in self.frames.column_names:
            column = self.frames[name].combine_chunks()
            axes = self.features.get(name, {}).get("names")
            if not _is_vector(column):
                has_axis = isinstance(axes, list) and len(axes) == 1
                columns[f"{name}.{axes[0]}" if has_axis else name] = column
                continue
            values = _matrix(column, len(self.frames))
            names = axes if isinstance(axes, list) else range(values.shape[1])
            columns |= {f"{name}.{n}": values[:, k] for k, n in enumerate(names)}
        return pa.table(columns)

    def _points(self) -> pa.Table:
        count = len(self.frames)
        x, z = (
            _matrix(self.frames[f"observation.profile_{a}"].combine_chunks(), count) for a in "xz"
        )
        row, i = np.nonzero(np.isfinite(x))
        stamp = self.frames["observation.profile_stamp"].to_numpy()
        return pa.table({"t": stamp[row], "i": i, "x": x[row, i], "z": z[row, i]})


def _is_vector(column: pa.Array) -> bool:
    return bool(pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type))


def _matrix(column: pa.Array, count: int) -> Array:
    """Vectors of one length as a matrix (count, m); ConfigurationError where they differ."""
    flat = column.flatten() if _is_vector(column) else column
    values = flat.to_numpy(zero_copy_only=False).astype(np.float64)
    if count == 0 or len(values) % count:
        raise ConfigurationError(f"a LeRobot feature holds {len(values)} values in {count} frames")
    return np.asarray(values.reshape(count, -1))


def episodes(root: Path) -> Iterator[Episode]:
    """Yield the episodes of the data set at `root`, each with its own frames.

    Raises ConfigurationError for a data set of another version, or one that is not whole.
    """
    info = read_json(root / INFO)
    if not str(info.get("codebase_version", "")).startswith("v3."):
        raise ConfigurationError(
            f"{root / INFO}: codebase_version: is {info.get('codebase_version')!r}, must be v3.x; "
            "convert it with LeRobot's own script"
        )
    features = info.get("features")
    mapping = root / "meta" / MAPPING
    shared = {MAPPING: read_bytes(mapping, MEGABYTE)} if mapping.is_file() else {}
    for path in sorted((root / "meta" / "episodes").glob("*/*.parquet")):
        for row in read_parquet(path).to_pylist():
            try:
                yield _read(root, row, features if isinstance(features, dict) else {}, shared)
            except (KeyError, TypeError, ValueError) as error:
                raise ConfigurationError(f"{path}: a row is not whole: {error}") from None


def _read(
    root: Path, row: Mapping[str, Any], features: Mapping[str, Any], shared: Mapping[str, bytes]
) -> Episode:
    """Read the episode that one `row` of meta/episodes describes."""
    place = {"chunk_index": row["data/chunk_index"], "file_index": row["data/file_index"]}
    path = root / DATA.format(**place)
    frames = read_parquet(path)
    own = np.asarray(frames["episode_index"]) == row["episode_index"]
    documents = {
        name: row[f"cell/{name}"].encode() for name in (RUN, RESULT) if row.get(f"cell/{name}")
    }
    touch = {str(k): float(v) for k, v in json.loads(row.get("cell/touch") or "{}").items()}
    name = str(row.get("cell/name") or f"episode-{row['episode_index']:06d}")
    if Path(name).name != name:
        raise ValueError(f"cell/name: {name!r} is not the name of a folder")
    return Episode(
        path, name, {**shared, **documents}, frames.filter(pa.array(own)), features, touch
    )
