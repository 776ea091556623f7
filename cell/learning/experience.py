"""Measured deviations of folds, from which a cell learns, kept in the user's data folder."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from cell.record.json_lines import json_line
from drivers.errors import ConfigurationError
from drivers.files import append_line, lock_folders, replace_file, sync_folder, writing
from drivers.readers import read_json_lines

NEWEST = 200  # experiences that are kept in use
Offset = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]  # m


@dataclass(frozen=True, slots=True)
class Experience:
    """Deviations [m] of one measured fold, as if policy and laying had not been corrected.

    `displacement` is measured minus predicted, `edges` the offset of the laid edges as seen.
    `policy` names the policy with its weights. A `ruler` experience holds no displacement but
    `rig` [m], the offset of the laid edges by the ruler minus that by the camera.
    """

    run: str
    policy: str
    strip: str
    specimen: str
    kind: Literal["camera", "ruler"]
    displacement: Offset = 0.0
    rig: Offset = 0.0
    edges: Offset | None = None


READER = TypeAdapter(Experience)


def _experience(line: dict[str, Any]) -> Experience | None:
    """Experience in a `line` of the memory; None for an invalid line."""
    try:
        return READER.validate_python(line)
    except ValidationError:
        return None


class Memory:
    """Stored experiences of one cell, oldest first, and whether learning is switched off."""

    def __init__(self, cell: str, folder: Path | None = None) -> None:
        """Store the experiences of `cell` in `folder`, by default the user's data folder."""
        self.folder = folder or data_folder() / "learning"
        self.path = self.folder / f"{cell}.jsonl"
        self._off = self.folder / f"{cell}.off"

    @property
    def is_off(self) -> bool:
        """Whether the last command switched learning off."""
        return self._off.exists()

    def switch(self, *, on: bool) -> None:
        """Switch learning on or off; no experience is lost.

        Raises ConfigurationError where the folder cannot be written.
        """
        with self._file_lock():
            if on:
                self._off.unlink(missing_ok=True)
            else:
                replace_file(self._off, b"")

    def experiences(self) -> tuple[Experience, ...]:
        """Read the newest experiences, oldest first; broken lines are skipped.

        Raises ConfigurationError for a file that cannot be read.
        """
        found = (_experience(line) for line in read_json_lines(self.path))
        return tuple(one for one in found if one is not None)[-NEWEST:]

    def add(self, experience: Experience) -> None:
        """Append one experience; it is on disk on return.

        Raises ConfigurationError where it cannot be written.
        """
        with self._file_lock():
            append_line(self.path, json_line(asdict(experience)))

    def forget(self) -> Path | None:
        """Set the experiences aside under the returned name; None where there are none.

        Raises ConfigurationError where the file cannot be moved.
        """
        with self._file_lock():
            if not self.path.exists():
                return None
            names = (f"{self.path.stem}.forgotten-{number}" for number in count(1))
            aside = next(p for p in map(self.path.with_name, names) if not os.path.lexists(p))
            self.path.rename(aside)
            sync_folder(self.folder)
            return aside

    @contextmanager
    def _file_lock(self) -> Iterator[None]:
        with writing(self.path, "the fold itself is recorded"):
            self.folder.mkdir(parents=True, exist_ok=True)
            with lock_folders([self.folder]):
                yield


def data_folder() -> Path:
    """Folder for data that cannot be computed again."""
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "folding-cell"


def ruler_experience(folder: Path, edges: float, memory: Memory) -> Experience:
    """Experience of the run in `folder`, whose laid edges lie `edges` [m] apart by a ruler.

    `memory` knows to which policy, fabric and specimen the run belongs. Raises ConfigurationError
    for a run that cannot be read, whose edges no camera saw, or that the cell did not learn from.
    """
    from cell.record.run import read_run  # and the libraries of its tables

    run = read_run(folder)
    seen = None if run.result is None else run.result.edge_offset
    if seen is None:
        raise ConfigurationError(
            f"{folder}: result.yaml: edge_offset: is missing, the camera saw no laid edges; "
            "measure a fold that was laid down"
        )
    for known in reversed(memory.experiences()):
        if known.run == folder.resolve().name and known.kind == "camera":
            return Experience(
                run=known.run,
                policy=known.policy,
                strip=known.strip,
                specimen=known.specimen,
                kind="ruler",
                rig=edges - seen,
            )
    raise ConfigurationError(
        f"{folder}: this cell did not learn from the run; fold with `--learning on` first"
    )
