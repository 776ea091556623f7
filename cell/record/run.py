"""Reading of a run: complete, interrupted, or written by hand in a laboratory."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.calibration import Calibration, load_calibration
from cell.record.columns import Profile, Sights, Ticks
from cell.record.files import (
    CALIBRATION,
    EVENTS,
    PROFILE,
    RESULT,
    RUN,
    SIGHT_STREAM,
    SIGHTS,
    TICK_STREAM,
    TICKS,
    check_run,
    is_under_way,
)
from cell.record.frames import FrameNote, read_frames, read_index
from cell.record.header import Header, Result
from cell.record.origin import moment, origin_of
from cell.record.stream import TICK_ROWS, read_stream
from cell.record.tables import Tables, assemble
from drivers.errors import ConfigurationError
from drivers.readers import read_json_lines, read_parquet
from drivers.settings import load
from drivers.types import Array, Frame, frozen


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a run at `t` [s]: its `kind` and its `facts`."""

    t: float
    kind: str
    facts: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Run:
    """A recorded run. `result` is None when the process died before it wrote one."""

    folder: Path
    header: Header
    ticks: Ticks
    profile: Profile
    result: Result | None

    @property
    def name(self) -> str:
        """Name of the run's folder."""
        return self.folder.name

    @property
    def died(self) -> bool:
        """Whether the run ended without a result and is not under way any more."""
        return self.result is None and not is_under_way(self.folder)

    def events(self) -> tuple[Event, ...]:
        """Events of the run in the order of writing; none in a laboratory's run.

        Events are written on the cell's clock, before the start of measured time is known; the
        event `origin` states it, and times here are relative to it.
        """
        lines = read_json_lines(self.folder / EVENTS)
        origin = origin_of(lines)
        return tuple(
            Event(moment(line.pop("t", None)) - origin, str(line.pop("kind", "")), line)
            for line in lines
        )

    def origin(self) -> float:
        """Cell's clock [s] at t = 0 of the run; 0 where the run does not state it."""
        return origin_of(read_json_lines(self.folder / EVENTS))

    def sights(self) -> Sights:
        """Measurements of all images; none in a laboratory's run."""
        path = self.folder / SIGHTS
        if path.exists():
            return Sights.of(read_parquet(path), str(path))
        if (self.folder / SIGHT_STREAM).exists():
            return Sights.of(assemble(self.folder).sights, str(self.folder / SIGHT_STREAM))
        return Sights.none()

    def costs(self) -> Array:
        """Computing time of each cycle of the loop (n,) [s]; empty where not recorded."""
        path = self.folder / TICK_STREAM
        if not path.exists():
            return frozen([])
        table = read_stream(path, TICK_ROWS)
        return frozen(table["cost"].to_numpy() if "cost" in table.column_names else [])

    def calibration(self) -> Calibration | None:
        """The calibration of the run's camera, where the run kept it."""
        path = self.folder / CALIBRATION
        return load_calibration(path) if path.exists() else None

    def frame_index(self) -> tuple[FrameNote, ...]:
        """Index entries of all processed images, in order; none in a laboratory's run."""
        return read_index(self.folder)

    def frames(self) -> Iterator[Frame]:
        """The kept images of the run, each verified against its hash."""
        return read_frames(self.folder)


def read_run(folder: Path) -> Run:
    """Read the run in `folder`; only the four files of a measured run are opened.

    A run that died before its tables were written is read from its streams. Raises
    ConfigurationError for files that are missing, broken, or written by a newer version.
    """
    check_run(folder)
    header = load(folder / RUN, Header)
    result = read_result(folder)
    ticks, profile = folder / TICKS, folder / PROFILE
    if result is None and not (ticks.exists() and profile.exists()):
        tables, origin = tables_from_streams(folder, header)
        return Run(
            folder, header, Ticks.of(tables.ticks, origin), Profile.of(tables.profile, origin), None
        )
    return Run(
        folder,
        header,
        Ticks.of(read_parquet(ticks), str(ticks)),
        Profile.of(read_parquet(profile), str(profile)),
        result,
    )


def read_result(folder: Path) -> Result | None:
    """Read the result of the run in `folder`; None where none was written.

    Raises ConfigurationError for one that cannot be read.
    """
    path = folder / RESULT
    return load(path, Result, bare=True) if path.exists() else None


def tables_from_streams(folder: Path, header: Header) -> tuple[Tables, str]:
    """Make the tables of an interrupted run from its streams; returns them and their source.

    A run of the cell may have died before its streams were begun. Raises ConfigurationError for any
    other run without tables.
    """
    begun = any((folder / name).exists() for name in (TICK_STREAM, EVENTS))
    if not begun and header.config is None:
        missing = TICKS if not (folder / TICKS).exists() else PROFILE
        raise ConfigurationError(
            f"{folder}: {missing}: is missing, and there is no {TICK_STREAM} to make it from"
        )
    return assemble(folder), str(folder / TICK_STREAM)
