"""Recording interface of the orchestrator; measured time begins with the lift, or after it."""

from dataclasses import replace
from typing import Any

from cell.orchestrator.snapshot import Snapshot
from cell.perception.measurement import StripMeasurement
from cell.record.events import LIFT, ORIGIN
from cell.record.tables import Tick
from cell.record.writer import RunWriter
from drivers.types import Array, Frame
from policies.policy import Decision


class Recorder:
    """Recorder that keeps nothing, base of those that do; times on the cell's clock [s]."""

    @property
    def origin(self) -> float:
        """Clock time of t = 0 [s]."""
        return 0.0

    def describe(self, **facts: Any) -> None:
        """Add facts to the header that were not known at the start."""

    def begin(self, clock: float) -> None:
        """Start measured time at `clock` [s], that of the lift; a second call starts it anew."""

    def tick(self, snapshot: Snapshot, cost: float) -> None:
        """Add one cycle of the control loop that took `cost` [s] to compute."""

    def sight(self, measurement: StripMeasurement) -> None:
        """Add the measurement from one image."""

    def frame(self, frame: Frame) -> None:
        """Add an image that was processed."""

    def decision(self, snapshot: Snapshot, decision: Decision) -> None:
        """Add the policy's decision on a measurement."""

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Add an event at `clock` [s]."""


class FileRecorder(Recorder):
    """Recorder that writes a run's folder; t = 0 where the strip is still and held.

    Ticks and measurements are recorded from the lift on. Earlier images are kept until then and get
    negative times; events carry the cell's clock, and the event `origin` states where t = 0 is. A
    run that starts `hanging` counts the time of its streams from the event `lift`, and its tables
    hold what came after `origin`.
    """

    def __init__(self, writer: RunWriter, *, hanging: bool = False) -> None:
        """Record with `writer`; `hanging` where the lift is not part of the measured run."""
        self._writer = writer
        self._hanging = hanging
        self._lift: float | None = None
        self._origin: float | None = None
        self._early: list[Frame] = []

    @property
    def origin(self) -> float:
        """Clock time of t = 0 [s]; 0 before it is known."""
        return self._origin or 0.0

    def describe(self, **facts: Any) -> None:
        """Add facts to run.yaml that were not known at the start."""
        self._writer.describe(**facts)

    def begin(self, clock: float) -> None:
        """Start measured time with the lift at `clock` [s], or again where `hanging`."""
        if self._lift is None:
            self._lift = clock
            self._flush_early()
            if self._hanging:
                self._writer.event(clock, LIFT)
                return
        self._origin = clock
        self._writer.event(clock, ORIGIN)

    def tick(self, snapshot: Snapshot, cost: float) -> None:
        """Add one cycle of the control loop; nothing before the lift."""
        if self._lift is None:
            return
        row = Tick.from_state(snapshot.arm, snapshot.state, cost)
        self._writer.tick(replace(row, t=row.t - self._lift))

    def sight(self, measurement: StripMeasurement) -> None:
        """Add the measurement from one image."""
        if self._lift is not None and measurement.stamp >= self._lift:
            self._writer.sight(replace(measurement, stamp=measurement.stamp - self._lift))

    def frame(self, frame: Frame) -> None:
        """Add an image that perception processed."""
        if self._lift is None:
            self._early.append(frame)
        else:
            self._writer.frame(_shift_times(frame, -self._lift))

    def decision(self, snapshot: Snapshot, decision: Decision) -> None:
        """Add the policy's decision on the newest measurement, for `cell replay`."""
        seen = snapshot.view.measurement
        if seen is None:
            return
        pose, time = snapshot.arm.pose, snapshot.time - self.origin
        facts = {"sequence": seen.sequence, "x": pose.x, "z": pose.z, "time": time}
        facts |= {"direction": float(decision.direction[0]), "done": bool(decision.done[0])}
        self._writer.event(snapshot.time, "decision", **facts)

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Add an event at `clock` [s]."""
        self._writer.event(clock, kind, **facts)

    def joints(self, rows: Array) -> None:
        """Add the robot's joints at every tick, rows (n, 29) on the cell's clock."""
        if rows.size:
            self._writer.joints(rows, self.origin)

    def finish(self, result: dict[str, Any]) -> None:
        """Complete the record with `result`; may be called twice."""
        self._flush_early()
        self._writer.finish(result)

    def close(self) -> None:
        """Close the files."""
        self._writer.close()

    def _flush_early(self) -> None:
        early, self._early = self._early, []
        for frame in early:
            self._writer.frame(_shift_times(frame, -(self._lift or 0.0)))


def _shift_times(frame: Frame, offset: float) -> Frame:
    return replace(frame, stamp=frame.stamp + offset, arrival=frame.arrival + offset)
