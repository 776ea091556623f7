"""Converts a run to a sequence of ticks and log lines for display."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from math import nan

import numpy as np

from cell.perception.measurement import StripMeasurement
from cell.record.outlook import PREDICTED, Outlook
from cell.record.run import Run
from drivers.types import Array, Frame, Image

EVERY_FRAME = frozenset({"decision", PREDICTED})  # kinds of events that are not worth a line


@dataclass(frozen=True, slots=True)
class TickView:
    """A tick for display: `clock` [s], `t` since the lift [s] (NaN before), gripper `pose` (3,);
    `measurement`, `image` and `outlook`, a row of `cell.record.outlook`, only when new.
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
    """A line for the log at `clock` [s] and `t` [s]; `alarm` marks what stopped the run."""

    clock: float
    text: str
    alarm: bool
    t: float = nan


def log_text(kind: str, facts: dict[str, object]) -> str:
    """An event as a line of text."""
    if set(facts) == {"state", "event"}:
        return f"{facts['state']}, after {facts['event']}"
    text = ", ".join([kind, *(f"{key} {value}" for key, value in facts.items())])
    return text if len(text) <= 300 else f"{text[:297]}..."


def moments_of(run: Run) -> Iterator[TickView | LogLine]:
    """Ticks of a run, with kept images and their measurements, and events, in the order of time."""
    origin = run.origin()
    words: Iterator[TickView | LogLine] = (
        LogLine(
            event.t + origin,
            log_text(event.kind, dict(event.facts)),
            event.kind == "fault",
            event.t,
        )
        for event in sorted(run.events(), key=lambda event: event.t)
        if event.kind not in EVERY_FRAME
    )
    ticks: Iterator[TickView | LogLine] = _ticks(run, origin)
    yield from heapq.merge(words, ticks, key=lambda item: item.clock)


def _ticks(run: Run, origin: float) -> Iterator[TickView]:
    frames, sights = run.frames(), iter(_sights(run))
    frame, measurement = next(frames, None), next(sights, None)
    still = np.full(3, np.nan)
    while frame is not None and frame.stamp < 0:
        yield TickView(frame.stamp + origin, np.nan, 0, "", still, image=frame.image)
        frame = next(frames, None)
    outlook, passed = Outlook.of(run.events()), 0
    ticks = run.ticks
    poses = np.stack([ticks.x, ticks.z, ticks.pitch], axis=1)
    for row, t in enumerate(ticks.t):
        seen: StripMeasurement | None = None
        shown: Frame | None = None
        while measurement is not None and measurement.stamp <= t:
            seen, measurement = measurement, next(sights, None)
        while frame is not None and frame.stamp <= t:
            shown, frame = frame, next(frames, None)
        ahead: Array | None = None
        while passed < len(outlook.t) and outlook.t[passed] <= t:
            ahead, passed = outlook.rows[passed], passed + 1
        yield TickView(
            clock=float(t) + origin,
            t=float(t),
            tick=row,
            state=ticks.state[row] if ticks.state else "",
            pose=poses[row],
            measurement=seen,
            image=None if shown is None else shown.image,
            outlook=ahead,
        )


def _sights(run: Run) -> list[StripMeasurement]:
    """Measurements of a run, image by image; of a laboratory's run only the curves."""
    sights, curves = run.sights(), run.profile.curves()
    if sights.stamp.size == 0:
        return [_curve_only(t, points) for t, points in curves]
    points_at = dict(curves)
    return [
        StripMeasurement(
            stamp=float(stamp),
            sequence=int(sights.sequence[i]),
            contact_x=float(sights.contact_x[i]),
            contact_confidence=float(sights.contact_confidence[i]),
            profile=points_at.get(float(stamp), np.empty((0, 2))),
            profile_confidence=float(sights.profile_confidence[i]),
            tip=(float(sights.tip_x[i]), float(sights.tip_z[i])),
            gap=float(sights.gap[i]),
            gap_x=float(sights.gap_x[i]),
        )
        for i, stamp in enumerate(sights.stamp)
    ]


def _curve_only(t: float, points: Array) -> StripMeasurement:
    nothing = float("nan")
    return StripMeasurement(t, 0, nothing, 0.0, points, 1.0, (nothing, nothing), nothing, nothing)
