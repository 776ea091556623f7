"""Recorders of a run, whose measured time begins with the lift, or once the strip hangs
still.
"""

from dataclasses import replace
from typing import Any

from cell.orchestrator.snapshot import Snapshot
from cell.perception.strip_measurement import StripMeasurement
from cell.record.events import LIFT, ORIGIN
from cell.record.writer import RunWriter
from drivers.base.types import Array, Frame


class Recorder:
    """Base class of a run's recorders, which stores nothing itself; its clock times are
    in seconds.
    """

    @property
    def origin(self) -> float:
        """Clock time [s] at which measured time is t = 0."""
        return 0.0

    def describe(self, **facts: Any) -> None:
        """Add `facts` to the run's header that were not known at its start."""

    def begin(self, clock: float) -> None:
        """Start measured time at the clock time `clock` [s]; a second call restarts
        it.
        """

    def tick(self, snapshot: Snapshot) -> None:
        """Record the `snapshot` of a control cycle."""

    def sight(self, measurement: StripMeasurement) -> None:
        """Record the measurement of the strip in one image."""

    def frame(self, frame: Frame) -> None:
        """Record an image that was measured."""

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Record an event at the clock time `clock` [s]."""


class FileRecorder(Recorder):
    """Recorder that writes a run's folder; its t = 0 is the lift or, in a run that
    starts hanging, where the strip hangs still.

    Ticks and measurements are recorded from the lift on. Earlier images are kept until
    then and get negative times; events carry the cell's clock, and the event `origin`
    states where t = 0 is. A run that starts `hanging` counts the time of its streams
    from the event `lift`, and its tables hold what came after `origin`.
    """

    def __init__(self, writer: RunWriter, *, hanging: bool = False) -> None:
        """Record a run with `writer`; if `hanging`, the lift is not part of the
        measured time.
        """
        self._writer = writer
        self._hanging = hanging
        self._lift: float | None = None
        self._origin: float | None = None
        self._early: list[Frame] = []

    @property
    def origin(self) -> float:
        """Clock time [s] at which measured time is t = 0; 0 before it has begun."""
        return self._origin or 0.0

    def describe(self, **facts: Any) -> None:
        """Add `facts` that were not known at the run's start to run.yaml."""
        self._writer.describe(**facts)

    def begin(self, clock: float) -> None:
        """Start measured time at the lift, `clock` [s]; in a run that starts hanging,
        the second call starts it.
        """
        if self._lift is None:
            self._lift = clock
            self._flush_early()
            if self._hanging:
                self._writer.event(clock, LIFT)
                return
        self._origin = clock
        self._writer.event(clock, ORIGIN)

    def tick(self, snapshot: Snapshot) -> None:
        """Record a control cycle; cycles before the lift are ignored."""
        if self._lift is not None:
            arm = replace(snapshot.arm, stamp=snapshot.arm.stamp - self._lift)
            self._writer.tick(arm, snapshot.state, closed=snapshot.closed)

    def sight(self, measurement: StripMeasurement) -> None:
        """Record the measurement of the strip in one image; ignored before the lift."""
        lift = self._lift
        if lift is not None and measurement.stamp >= lift:
            self._writer.sight(replace(measurement, stamp=measurement.stamp - lift))

    def frame(self, frame: Frame) -> None:
        """Record a measured image; images from before the lift are written once t = 0
        is known.
        """
        self._early.append(frame)
        if self._lift is not None:
            self._flush_early()

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Record an event at the clock time `clock` [s]."""
        self._writer.event(clock, kind, **facts)

    def joints(self, rows: Array) -> None:
        """Record the robot's joints at each of its ticks: `rows` (n, 29) on the cell's
        clock.
        """
        if rows.size:
            self._writer.joints(rows, self.origin)

    def finish(self, result: dict[str, Any]) -> None:
        """Complete the run's folder by writing `result` to result.yaml; a second call
        is allowed.
        """
        self._flush_early()
        self._writer.finish(result)

    def close(self) -> None:
        """Close the files of the run's folder."""
        self._writer.close()

    def _flush_early(self) -> None:
        """Write the images that are not written yet."""
        for frame in self._early:
            self._writer.frame(_shift_times(frame, -(self._lift or 0.0)))
        self._early = []


def _shift_times(frame: Frame, offset: float) -> Frame:
    return replace(frame, stamp=frame.stamp + offset, arrival=frame.arrival + offset)
