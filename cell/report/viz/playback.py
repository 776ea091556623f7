"""Playback of a recorded run: its ticks and log lines in order of time, for a
viewer.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from math import inf, nan
from typing import TypeVar

import numpy as np

from cell.perception.strip_measurement import StripMeasurement
from cell.record.events import EVERY_FRAME, Outlook
from cell.record.files import FILM
from cell.record.run import Run
from cell.report.words import log_line
from drivers.base.types import Array, Frame, Image

ROUNDING = 1e-6  # s, of a stamp beside the same one in another file
PICTURE_PERIOD = 0.1  # s between images that are shown
LONGEST_WAIT = 0.3  # s for an image that was read
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class TickView:
    """Tick of a run for display, with the measurement, image and prediction that are
    new at it.

    `clock` [s], `t` since the lift [s] (NaN before), gripper `pose` (3,); `outlook` is
    a row of `cell.record.events`.
    """

    clock: float
    t: float
    tick: int
    state: str
    pose: Array
    measurement: StripMeasurement | None = None
    image: Image | None = None
    outlook: Array | None = None


@dataclass(frozen=True, slots=True)
class LogLine:
    """Line of a run's log at `clock` [s] of the cell and `t` [s] since the lift;
    `alarm` marks a fault.
    """

    clock: float
    text: str
    alarm: bool
    t: float = nan


def moments_of(run: Run) -> Iterator[TickView | LogLine]:
    """Yield ticks and log lines of a run in the order of time."""
    origin = run.origin()
    log: Iterator[TickView | LogLine] = (
        LogLine(
            event.t + origin,
            log_line(event.kind, event.facts),
            event.kind == "fault",
            event.t,
        )
        for event in sorted(run.events(), key=lambda event: event.t)
        if event.kind not in EVERY_FRAME
    )
    ticks: Iterator[TickView | LogLine] = _ticks(run, origin)
    yield from heapq.merge(log, ticks, key=lambda item: item.clock)


def _ticks(run: Run, origin: float) -> Iterator[TickView]:
    """Yield the run's ticks with what is new at each; an image from before t = 0
    first.
    """
    ticks = run.ticks
    t = ticks.t
    pictures = _pictures_of(run)
    before, first = None, next(pictures, None)
    while first is not None and first.stamp < 0:
        before, first = first, next(pictures, None)
    if before is not None:
        clock = before.stamp + origin  # gripper and state are not recorded yet
        nowhere = np.full(3, nan)
        yield TickView(clock, nan, 0, state="", pose=nowhere, image=before.image)
    later = pictures if first is None else chain([first], pictures)
    # an image that was read stands where it was, so that both are new at once
    read_at = {each.sequence: each.stamp for each in run.measurements()}
    outlook = Outlook.from_events(run.events())
    poses = np.stack([ticks.x, ticks.z, ticks.pitch], axis=1)
    news = zip(
        _newest_at(t, ((each.stamp, each) for each in run.measurements())),
        _newest_at(
            t,
            ((read_at.get(each.sequence, each.stamp), each.image) for each in later),
        ),
        _newest_at(t, zip(outlook.t, outlook.rows, strict=True)),
        strict=True,
    )
    for row, (measurement, image, prediction) in enumerate(news):
        yield TickView(
            clock=float(t[row]) + origin,
            t=float(t[row]),
            tick=row,
            state=ticks.state[row] if ticks.state else "",
            pose=poses[row],
            measurement=measurement,
            image=image,
            outlook=prediction,
        )


def _pictures_of(run: Run) -> Iterator[Frame]:
    """Yield images of a run at most every PICTURE_PERIOD: of its film, or else those
    kept.

    While images were read, one that was is preferred, since only over it can be drawn
    what was read.
    """
    has_film = (run.folder / FILM).is_file()
    sights = run.sights()
    read = set(sights.sequence.astype(int).tolist())
    first, last = min(read, default=0), max(read, default=-1)
    due = -inf
    for frame in run.film_frames() if has_film else run.frames():
        is_late = frame.stamp >= due + LONGEST_WAIT
        is_wanted = frame.sequence in read or not first <= frame.sequence <= last
        if frame.stamp >= due and (is_wanted or is_late):
            due = frame.stamp + PICTURE_PERIOD
            yield frame


def _newest_at(
    times: Array, stamped: Iterator[tuple[float, Item]]
) -> Iterator[Item | None]:
    """Yield for each of `times` (n,) [s] the newest item stamped since the one before,
    or None.
    """
    following = next(stamped, None)
    for t in times:
        newest: Item | None = None
        while following is not None and following[0] <= t + ROUNDING:
            newest = following[1]
            following = next(stamped, None)
        yield newest
