"""The record as the orchestrator writes it: measured time begins with the lift."""

from dataclasses import replace
from typing import Any, Protocol

from calibration.perception.measurement import StripMeasurement
from cell.orchestrator.snapshot import Snapshot
from cell.record.tick import Tick
from cell.record.writer import RunWriter
from drivers.types import Frame
from policies.policy import Decision


class Record(Protocol):
    """What a run tells of itself; times on the cell's clock [s]."""

    @property
    def origin(self) -> float:
        """Clock time of t = 0."""
        ...

    def describe(self, **facts: Any) -> None:
        """What belongs at the head of the record and was only learned now."""
        ...

    def begin(self, clock: float) -> None:
        """Let measured time begin."""
        ...

    def tick(self, snapshot: Snapshot, cost: float) -> None:
        """A turn of the control loop that took `cost` [s] to compute."""
        ...

    def sight(self, sight: StripMeasurement) -> None:
        """What one image showed."""
        ...

    def frame(self, frame: Frame) -> None:
        """An image that was looked at."""
        ...

    def decision(self, snapshot: Snapshot, decision: Decision) -> None:
        """What the policy decided on a sight."""
        ...

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Something that happened."""
        ...


class Recorder:
    """Turns the cell's clock into the run's: t = 0 where the strip lies flat, still and held.

    Rows and sights are recorded from `begin` on. Images from before are kept until then and get
    negative times; events carry the cell's clock, and the event `origin` says where t = 0 is.
    """

    def __init__(self, writer: RunWriter) -> None:
        self._writer = writer
        self._origin: float | None = None
        self._early: list[Frame] = []

    @property
    def origin(self) -> float:
        """Clock time of t = 0 [s]; 0 before the lift."""
        return self._origin or 0.0

    def describe(self, **facts: Any) -> None:
        """Add to run.yaml what was only learned now."""
        self._writer.describe(**facts)

    def begin(self, clock: float) -> None:
        """Let measured time begin at `clock` [s]."""
        self._origin = clock
        self._writer.event(clock, "origin")
        self._flush_early()

    def tick(self, snapshot: Snapshot, cost: float) -> None:
        """Add a turn of the control loop; nothing before the lift."""
        if self._origin is None:
            return
        row = Tick.of(snapshot.arm, snapshot.state, cost)
        self._writer.tick(replace(row, t=row.t - self._origin))

    def sight(self, sight: StripMeasurement) -> None:
        """Add what one image showed."""
        if self._origin is not None and sight.stamp >= self._origin:
            self._writer.sight(replace(sight, stamp=sight.stamp - self._origin))

    def frame(self, frame: Frame) -> None:
        """Add an image that perception saw."""
        if self._origin is None:
            self._early.append(frame)
        else:
            self._writer.frame(_shifted(frame, -self._origin))

    def decision(self, snapshot: Snapshot, decision: Decision) -> None:
        """Add what the policy decided on the newest sight, for `cell replay`."""
        if snapshot.view.frame is not None:
            facts = {"sequence": snapshot.view.frame.sequence, "x": snapshot.arm.pose.x}
            facts |= {"z": snapshot.arm.pose.z, "time": snapshot.time - self.origin}
            facts |= {"direction": float(decision.direction[0]), "done": bool(decision.done[0])}
            self._writer.event(snapshot.time, "decision", **facts)

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Add something that happened at `clock` [s]."""
        self._writer.event(clock, kind, **facts)

    def finish(self, result: dict[str, Any]) -> None:
        """Complete the record; allowed twice."""
        self._flush_early()
        self._writer.finish(result)

    def close(self) -> None:
        """Let go of the files."""
        self._writer.close()

    def _flush_early(self) -> None:
        early, self._early = self._early, []
        for frame in early:
            self._writer.frame(_shifted(frame, -self.origin))


def _shifted(frame: Frame, offset: float) -> Frame:
    return replace(frame, stamp=frame.stamp + offset, arrival=frame.arrival + offset)


class NullRecorder:
    """Takes everything a recorder takes and keeps nothing."""

    origin = 0.0

    def describe(self, **facts: Any) -> None:
        """Not kept."""

    def begin(self, clock: float) -> None:
        """Nothing to begin."""

    def tick(self, snapshot: Snapshot, cost: float) -> None:
        """Not kept."""

    def sight(self, sight: StripMeasurement) -> None:
        """Not kept."""

    def frame(self, frame: Frame) -> None:
        """Not kept."""

    def decision(self, snapshot: Snapshot, decision: Decision) -> None:
        """Not kept."""

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Not kept."""
