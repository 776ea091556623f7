"""Deviations of measured folds from their predictions, stored in the user's data
folder.
"""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from cell.record.documents import json_line
from cell.record.files import TICKS
from drivers.base.errors import ConfigurationError
from drivers.base.files import append_line, lock_folders, replace_file, writing
from drivers.base.readers import LARGEST_LINES, LARGEST_TABLE, read_bytes

NEWEST = 200  # experiences that are kept in use
Offset = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]  # m


@dataclass(frozen=True, slots=True)
class Experience:
    """What one measured fold teaches: its deviations [m] from the prediction, as they
    would be if nothing had been corrected.

    `displacement` is measured minus predicted, `edges` the offset of the laid edges as
    seen. `policy` names the policy with its weights. A `ruler` experience holds no
    displacement but `rig` [m], the offset of the laid edges by the ruler minus that by
    the camera. `key` is the run's `run_key`; `aim` and `place` [m] are the corrections
    that were in use.
    """

    run: str
    policy: str
    strip: str
    specimen: str
    kind: Literal["camera", "ruler"]
    displacement: Offset = 0.0
    rig: Offset = 0.0
    edges: Offset | None = None
    key: str = ""
    aim: Offset = 0.0
    place: Offset = 0.0


READER = TypeAdapter(Experience)


def run_key(folder: Path) -> str:
    """Short hexadecimal digest of the measurements of the run in `folder`, which
    identifies it; empty for a run without measurements.
    """
    path = folder / TICKS
    if not path.exists():
        return ""
    return hashlib.sha256(read_bytes(path, LARGEST_TABLE)).hexdigest()[:16]


class Memory:
    """Stored deviations of the folds of one cell from their predictions, oldest first,
    and whether the cell is to learn from them.

    Folds of the `twin` have a memory of their own: their bias is none of the real cell.
    """

    def __init__(
        self, cell: str, folder: Path | None = None, *, twin: bool = False
    ) -> None:
        """Open the memory of the cell named `cell` in `folder` or, where that is None,
        in the user's data folder.
        """
        self.folder = folder or _data_folder() / "learning"
        self.path = self.folder / f"{cell}{'.twin' if twin else ''}.jsonl"
        self._off = self.folder / f"{cell}.off"

    @property
    def is_off(self) -> bool:
        """Whether learning was switched off, which holds for the real cell and for its
        simulation alike.
        """
        return self._off.exists()

    def switch(self, *, on: bool) -> None:
        """Switch learning on or off without losing anything that was learned;
        ConfigurationError where the file cannot be written.
        """
        with self._file_lock():
            if on:
                self._off.unlink(missing_ok=True)
            else:
                replace_file(self._off, b"")

    def experiences(self) -> tuple[Experience, ...]:
        """Newest deviations in the memory, oldest first, one for each run and measuring
        instrument; broken lines are skipped.

        A later experience of a run, by the same instrument, replaces the earlier one.
        Raises ConfigurationError for a file that cannot be read.
        """
        return self._all()[-NEWEST:]

    def largest_corrections(self) -> tuple[float, float]:
        """Largest corrections [m] with which any stored fold was made: that of the aim,
        and that of where the edge is laid.
        """
        experiences = self._all()
        aim = max((one.aim for one in experiences), key=abs, default=0.0)
        return aim, max((one.place for one in experiences), key=abs, default=0.0)

    def find(self, run: Path) -> tuple[Experience, ...]:
        """All that the memory holds of the run in the folder `run`, identified by its
        measurements or, where these are gone, by its name.
        """
        key = run_key(run)
        return tuple(one for one in self._all() if _is_of(one, key, run.resolve().name))

    def add(self, experience: Experience) -> None:
        """Append `experience` to the memory's file; ConfigurationError where that
        cannot be written.
        """
        with self._file_lock():
            last = self._lines()[-1:]
            # after a crash
            mend = b"\n" if last and not last[0].endswith(b"\n") else b""
            append_line(self.path, mend + json_line(asdict(experience)))

    def forget(self, run: Path | None = None) -> Path | None:
        """Move all that was learned, or what was learned from `run`, to another file;
        returns its path, or None where there was nothing to move.
        """
        with self._file_lock():
            lines = self._lines()
            forgotten = set(lines) if run is None else self._lines_of(run)
            if not forgotten:
                return None

            names = (f"{self.path.stem}.forgotten-{number}" for number in count(1))
            paths = map(self.path.with_name, names)
            aside = next(free for free in paths if not os.path.lexists(free))
            # first the copy, so that a crash between the two loses nothing
            replace_file(aside, b"".join(s for s in lines if s in forgotten))
            replace_file(self.path, b"".join(s for s in lines if s not in forgotten))
            return aside

    def _lines_of(self, run: Path) -> set[bytes]:
        """Lines of the memory's file that hold what was learned from the run in the
        folder `run`.
        """
        key = run_key(run)
        name = run.resolve().name
        read = ((line, _experience(line)) for line in self._lines())
        return {line for line, one in read if one and _is_of(one, key, name)}

    def _lines(self) -> list[bytes]:
        if not self.path.exists():
            return []
        return read_bytes(self.path, LARGEST_LINES).splitlines(keepends=True)

    def _all(self) -> tuple[Experience, ...]:
        """All that was learned, oldest first: of each run and measuring instrument the
        latest entry.
        """
        latest: dict[tuple[str, str], Experience] = {}
        for experience in filter(None, map(_experience, self._lines())):
            latest[experience.key or experience.run, experience.kind] = experience
        return tuple(latest.values())

    @contextmanager
    def _file_lock(self) -> Iterator[None]:
        with writing(self.path, "the fold itself is recorded"):
            self.folder.mkdir(parents=True, exist_ok=True)
            with lock_folders([self.folder]):
                yield


def _experience(line: bytes) -> Experience | None:
    """What one `line` of a memory's file holds; None where the line is not valid."""
    try:
        return READER.validate_json(line)
    except ValidationError:
        return None


def _is_of(experience: Experience, key: str, name: str) -> bool:
    """Whether an experience is from the run with the digest `key` or, where either has
    no digest, from the run called `name`.
    """
    return experience.key == key if experience.key and key else experience.run == name


def _data_folder() -> Path:
    """Path of the user's folder for data that cannot be recomputed."""
    return (
        Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share")
        / "folding-cell"
    )


def experience_by_ruler(run: Path, edges: float, memory: Memory) -> Experience:
    """What a ruler teaches that shows the laid edges of the fold in the folder `run` to
    be `edges` [m] apart: how far the camera misreads.

    Its policy, fabric and specimen are those under which `memory` holds the run. Raises
    ConfigurationError for a run that is not in `memory`, or whose edges no camera saw.
    """
    from cell.record.run import read_run  # and the libraries of its tables

    result = read_run(run).result
    if result is None or result.edge_offset is None:
        raise ConfigurationError(
            f"{run}: result.yaml: edge_offset: is missing, the camera saw no laid"
            " edges; measure a fold that was laid down"
        )
    by_camera = [one for one in memory.find(run) if one.kind == "camera"]
    if not by_camera:
        raise ConfigurationError(
            f"{run}: this cell did not learn from the run; fold with `--learning on`"
            " first"
        )
    newest = by_camera[-1]
    facts = {
        name: getattr(newest, name)
        for name in ("run", "key", "policy", "strip", "specimen")
    }
    return Experience(**facts, kind="ruler", rig=edges - result.edge_offset)
