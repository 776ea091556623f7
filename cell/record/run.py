"""Reading of a recorded run: complete, interrupted, damaged, or written by another
program.
"""

import base64
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial, wraps
from html import escape
from math import nan
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar, cast

import numpy as np
import pyarrow as pa

from calibration.calibration import Calibration, load_calibration
from cell.perception.strip_measurement import StripMeasurement
from cell.record import files
from cell.record.columns import Profile, Sights, Ticks
from cell.record.events import Event, origin_of, read_events
from cell.record.film import Film
from cell.record.frames import FrameNote, read_frame, read_index
from cell.record.header import Header, Result, read_result
from cell.record.tables import assemble
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_parquet
from drivers.base.settings import load
from drivers.base.types import Array, Frame

# what an arm measures
MOTION = ("t", "x", "z", "pitch", "x_cmd", "z_cmd", "pitch_cmd", "hand_cmd", "f_x",
          "f_z")  # fmt: skip
TOUCH = ("t_layer_touch", "l1", "l2", "displacement")  # of a result
Part = TypeVar("Part")
Columns = Mapping[str, Array]
NO_TABLES: Mapping[str, Columns] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class PartReader:
    """Reader of the parts of a recorded run, for which a broken part is an error or, if
    `lenient`, counts as empty.

    `problems` has a line for each part that was left empty.
    """

    lenient: bool = False
    problems: list[str] = field(default_factory=list)

    def read(self, part: Callable[[], Part], empty: Part) -> Part:
        """What the function `part` reads of a run; where that is broken, `empty` if the
        reader is lenient, else a ConfigurationError.
        """
        try:
            return part()
        except ConfigurationError as error:
            if not self.lenient:
                raise
            self.problems.extend(str(error).splitlines()[:1])
            return empty


def _cached_part(
    empty: object,
) -> Callable[[Callable[["Run"], Part]], Callable[["Run"], Part]]:
    """Decorator of a method that reads a part of a run, after which the part is read
    only once and then kept.

    A lenient run has `empty`, which cannot be changed, for a broken part.
    """

    def decorate(read: Callable[["Run"], Part]) -> Callable[["Run"], Part]:
        @wraps(read)
        def cached(run: "Run") -> Part:
            name = read.__name__
            if name not in run.parts:
                run.parts[name] = run.reader.read(
                    lambda: read(run), cast("Part", empty)
                )
            return cast("Part", run.parts[name])

        return cached

    return decorate


@dataclass(frozen=True, slots=True)
class Run:
    """Recorded run: its header, the gripper's motion, the strip's midlines, and the
    result, which is None where the process died before writing one.

    Its `reader` says whether broken parts are errors or empty; `parts` are those read
    so far.
    """

    folder: Path
    header: Header
    ticks: Ticks
    profile: Profile
    result: Result | None
    reader: PartReader = field(default_factory=PartReader, compare=False)
    parts: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)

    @property
    def name(self) -> str:
        """Name of the run's folder."""
        return self.folder.name

    def __fspath__(self) -> str:
        """Path of the run's folder, so that functions which take a path also take a
        run.
        """
        return str(self.folder)

    def __repr__(self) -> str:
        """Line of text with the name of the run, its outcome and, where these were
        measured, displacement and offset of the edges.
        """
        return f"{self.name}: {self.result or 'no result'}"

    def _repr_html_(self) -> str:
        """HTML for a notebook that shows the film of the run or, where it has none, its
        last stored image.
        """
        images = [note.file for note in self.kept_images()[::-1] if note.file]
        picture = next(filter(Path.is_file, (self.folder / files.FILM, *images)), None)
        text = escape(repr(self))
        if picture is None:
            return text

        content = base64.b64encode(picture.read_bytes()).decode()
        if picture.name == files.FILM:
            return (
                f'{text}<br><video controls width="640"'
                f' src="data:video/mp4;base64,{content}">'
            )

        return f'{text}<br><img width="640" src="data:image/png;base64,{content}">'

    @property
    def problems(self) -> list[str]:
        """Lines of text on those parts of the run that were broken and
        count as empty.
        """
        return self.reader.problems

    @property
    def died(self) -> bool:
        """Whether the process that recorded the run ended without a result."""
        return self.result is None and not files.is_under_way(self.folder)

    @_cached_part(())
    def events(self) -> tuple[Event, ...]:
        """Events of the run, in the order in which they were written, with times [s]
        that count as those of the run do.

        Events are written on the cell's clock, before the start of measured time is
        known; the event `origin` states it, and times here are relative to it.
        """
        events = read_events(self.folder)
        origin = origin_of(events)
        return tuple(replace(event, t=event.t - origin) for event in events)

    @_cached_part(0.0)
    def origin(self) -> float:
        """Time [s], on the clock of the cell, at which the time of the run is zero; 0
        where that is not recorded.
        """
        return origin_of(read_events(self.folder))

    @_cached_part(Sights.none())
    def sights(self) -> Sights:
        """Measurements of the strip in all images, as a table; empty where none were
        recorded.
        """
        path = self.folder / files.SIGHTS
        stream = self.folder / files.SIGHT_STREAM
        if path.exists():
            return Sights.parse(read_parquet(path), str(path))
        if stream.exists():
            return Sights.parse(assemble(self.folder)[files.SIGHTS], str(stream))
        return Sights.none()

    def measurements(self) -> list[StripMeasurement]:
        """Measurements of the strip, one for each image; where only midlines were
        recorded, these alone.
        """
        sights = self.sights()
        curves = dict(self.profile.curves())
        if sights.stamp.size == 0:
            return [
                StripMeasurement(
                    stamp=stamp,
                    sequence=0,
                    contact_x=nan,
                    contact_confidence=0.0,
                    profile=points,
                    profile_confidence=1.0,
                    tip=(nan, nan),
                    gap=nan,
                    gap_x=nan,
                )
                for stamp, points in curves.items()
            ]
        columns = {name: getattr(sights, name).tolist() for name in Sights.__slots__}
        rows = zip(*columns.values(), strict=True)
        return [
            _measurement(dict(zip(columns, row, strict=True)), curves) for row in rows
        ]

    @_cached_part(None)
    def calibration(self) -> Calibration | None:
        """Calibration of the camera that the run used; None where it was not stored
        with the run.
        """
        path = self.folder / files.CALIBRATION
        return load_calibration(path) if path.exists() else None

    @_cached_part(())
    def frame_index(self) -> tuple[FrameNote, ...]:
        """Index entries of all images of the run, in order; empty where no index was
        recorded.
        """
        return read_index(self.folder)

    @_cached_part(NO_TABLES)
    def tables(self) -> Mapping[str, Columns]:
        """Measurements of the run as tables by name, each of which holds columns of
        shape (rows,) in SI units by name.

        They are `ticks`, and where measured `contact`, `profile` and `result`, without
        columns that hold no number.
        """
        motion = {name: getattr(self.ticks, name) for name in MOTION}
        tables = {
            "ticks": {name: v for name, v in motion.items() if np.isfinite(v).any()}
        }
        stamps, contact_x = self.ticks.contacts()
        if len(stamps):
            tables["contact"] = {"t": stamps, "contact_x": contact_x}

        if len(self.profile.t):
            tables["profile"] = {
                name: getattr(self.profile, name) for name in Profile.__slots__
            }

        touch = {name: getattr(self.result, name, None) for name in TOUCH}
        if None not in touch.values():
            tables["result"] = {
                name: np.array([value]) for name, value in touch.items()
            }

        return tables

    def kept_images(self) -> list[FrameNote]:
        """Index entries of those images of the run whose files were stored,
        in order.
        """
        return [note for note in self.frame_index() if note.file is not None]

    def film_stamps(self) -> dict[int, float]:
        """Times [s] of the images in the film of the run, by their numbers in the film;
        empty where it has no film.
        """
        notes = self.frame_index() if (self.folder / files.FILM).is_file() else ()
        return {note.film: note.stamp for note in notes if note.film is not None}

    def film_frames(self, only: Collection[int] | None = None) -> Iterator[Frame]:
        """Yield the images of the run's film, each with its time and its number in the
        run; `only` limits them to these numbers.

        They end where the film breaks off; none without a film.
        """
        path = self.folder / files.FILM
        notes = {
            note.film: note
            for note in self.frame_index()
            if note.film is not None and (only is None or note.sequence in only)
        }
        if not (notes and path.is_file()):
            return
        with suppress(ConfigurationError):
            for frame in Film(path).frames(only=notes):
                yield notes[frame.sequence].frame(frame.image)

    def frames(self) -> Iterator[Frame]:
        """Yield the stored images of the run; ConfigurationError for one whose pixels
        have changed, unless the run is read leniently.
        """
        # the run's problems do not list images
        image_reader = PartReader(self.reader.lenient)
        for note in self.kept_images():
            frame = image_reader.read(partial(read_frame, note), None)
            if frame is not None:
                yield frame


def _measurement(
    sight: dict[str, Any], curves: Mapping[float, Array]
) -> StripMeasurement:
    """Measurement of the strip in one image, from its row `sight` and from that midline
    in `curves` which has the same time.
    """
    tip = (sight.pop("tip_x"), sight.pop("tip_z"))
    profile = curves.get(sight["stamp"], np.empty((0, 2)))
    sight["sequence"] = int(sight["sequence"])
    return StripMeasurement(**sight, profile=profile, tip=tip)


def read_run(folder: Path) -> Run:
    """Recorded run in `folder`: its header, motion, midlines and result; other parts
    are read once they are used.

    A run that died before its tables were written is read from its streams. Raises
    ConfigurationError for files that are missing, broken, or written by a newer
    version.
    """
    return _read(folder, lenient=False)


def read_broken_run(folder: Path) -> Run:
    """Recorded run in `folder`, of which parts that are broken count as empty;
    ConfigurationError where its header is broken.
    """
    run = _read(folder, lenient=True)
    for read in (run.events, run.sights, run.calibration, run.frame_index):
        read()
    run.problems[:] = dict.fromkeys(run.problems)
    return run


def _read(folder: Path, *, lenient: bool) -> Run:
    """Recorded run in `folder`; a broken part counts as empty if `lenient`, else it is
    an error.
    """
    files.check_run(folder)
    header = load(folder / files.RUN, Header)
    reader = PartReader(lenient)
    result = reader.read(lambda: read_result(folder), None)
    tables_of_streams = cache(partial(assemble, folder))
    begun = any((folder / name).exists() for name in (files.TICK_STREAM, files.EVENTS))

    def table(name: str) -> tuple[pa.Table, str]:
        """Table in the Parquet file `name` of the run, and the path, for messages about
        errors, of where it came from.

        One that is missing from an incomplete run is made from the streams, which a
        run of the cell that died at its start need not have.
        """
        path = folder / name
        if path.exists() or (result is not None and not lenient):
            return read_parquet(path), str(path)
        if not begun and header.config is None:
            raise ConfigurationError(
                f"{folder}: {name}: is missing, and there is no {files.TICK_STREAM} to"
                " make it from"
            )
        return tables_of_streams()[name], str(folder / files.TICK_STREAM)

    ticks = reader.read(lambda: Ticks.parse(*table(files.TICKS)), Ticks.none())
    profile = reader.read(lambda: Profile.parse(*table(files.PROFILE)), Profile.none())
    return Run(folder, header, ticks, profile, result, reader)
