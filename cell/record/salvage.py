"""Reading of a run with broken parts, as far as possible."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

import pyarrow as pa

from calibration.calibration import Calibration
from cell.record.columns import Profile, Sights, Ticks
from cell.record.files import PROFILE, RUN, TICK_STREAM, TICKS, check_run
from cell.record.frames import FrameNote, read_frame
from cell.record.header import Header
from cell.record.run import Event, Run, read_result, tables_from_streams
from cell.record.stream import SIGHT_ROWS, TICK_ROWS
from cell.record.tables import Tables, profile_table, tick_table
from drivers.errors import ConfigurationError
from drivers.readers import read_parquet
from drivers.settings import load
from drivers.types import Array, Frame, frozen

Found = TypeVar("Found")


@dataclass(frozen=True, slots=True)
class Salvage(Run):
    """A run whose broken parts are empty; `problems` has a line for each of them."""

    problems: tuple[str, ...]
    parts: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)
    noted: list[str] = field(default_factory=list, compare=False, repr=False)

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Read the intact parts of `folder`; ConfigurationError only where run.yaml is broken."""
        check_run(folder)
        header, problems = load(folder / RUN, Header), list[str]()
        ticks = _read_part(
            lambda: Ticks.of(*_table(folder, header, "ticks", problems)),
            lambda: Ticks.of(EMPTY_TABLES.ticks, TICKS),
            problems,
        )
        profile = _read_part(
            lambda: Profile.of(*_table(folder, header, "profile", problems)),
            lambda: Profile.of(EMPTY_TABLES.profile, PROFILE),
            problems,
        )
        result = _read_part(lambda: read_result(folder), lambda: None, problems)
        run = cls(folder, header, ticks, profile, result, ())
        for read in (run.events, run.sights, run.costs, run.calibration, run.frame_index):
            read()
        problems += run.noted
        distinct = tuple(dict.fromkeys(problems))
        return cls(folder, header, ticks, profile, result, distinct, run.parts)

    def _once(self, read: Callable[[Run], Found], empty: Callable[[], Found]) -> Found:
        """Result of `read` on the folder, cached, or `empty` where that fails."""
        name = read.__name__
        if name not in self.parts:
            self.parts[name] = _read_part(lambda: read(self), empty, self.noted)
        found: Found = self.parts[name]
        return found

    def events(self) -> tuple[Event, ...]:
        """Events of the run; none where they cannot be read."""
        return self._once(Run.events, lambda: ())

    def origin(self) -> float:
        """Cell's clock [s] at t = 0 of the run; 0 where the run does not state it."""
        return self._once(Run.origin, float)

    def sights(self) -> Sights:
        """Measurements of all images; none where they cannot be read."""
        return self._once(Run.sights, Sights.none)

    def costs(self) -> Array:
        """Computing time of each cycle (n,) [s]; empty where it cannot be read."""
        return self._once(Run.costs, lambda: frozen([]))

    def calibration(self) -> Calibration | None:
        """The calibration of the run's camera, where it can be read."""
        return self._once(Run.calibration, lambda: None)

    def frame_index(self) -> tuple[FrameNote, ...]:
        """Index entries of all processed images; none where the index cannot be read."""
        return self._once(Run.frame_index, lambda: ())

    def frames(self) -> Iterator[Frame]:
        """The kept images that are complete and match their hashes."""
        for note in self.frame_index():
            frame = _read_part(lambda: read_frame(note), lambda: None, [])  # noqa: B023
            if frame is not None:
                yield frame


EMPTY_TABLES = Tables(
    ticks=tick_table(TICK_ROWS.empty_table(), SIGHT_ROWS.empty_table()),
    profile=profile_table(SIGHT_ROWS.empty_table()),
    sights=SIGHT_ROWS.empty_table(),
)


def _table(folder: Path, header: Header, name: str, problems: list[str]) -> tuple[pa.Table, str]:
    """Read the table `name` (ticks or profile), or make it from the streams; with its source."""
    path, stream = folder / f"{name}.parquet", folder / TICK_STREAM
    try:
        if path.exists():
            return read_parquet(path), str(path)
    except ConfigurationError as error:
        if not stream.is_file():
            raise
        problems.append(f"{error}; read from {TICK_STREAM} instead")
    tables, origin = tables_from_streams(folder, header)
    return getattr(tables, name), origin


def _read_part(read: Callable[[], Found], empty: Callable[[], Found], problems: list[str]) -> Found:
    try:
        return read()
    except ConfigurationError as error:
        problems.extend(str(error).splitlines()[:1])
        return empty()
