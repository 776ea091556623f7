"""Writer of a run's folder: header, streams, events and images, then tables and
result.
"""

import fcntl
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cell.perception.strip_measurement import StripMeasurement
from cell.record import tables
from cell.record.documents import json_line, write_document
from cell.record.files import (
    EVENTS,
    JOINTS,
    RESULT,
    RUN,
    SIGHT_STREAM,
    TICK_STREAM,
    Keep,
)
from cell.record.film import Encoder
from cell.record.frames import FrameWriter
from cell.record.header import Header, Result
from drivers.base.errors import ConfigurationError, Fault
from drivers.base.files import new_file, write_all
from drivers.base.readers import SCHEMA
from drivers.base.settings import parse
from drivers.base.types import ArmState, Array, Frame


class RunWriter:
    """Writer of the folder of one run, of which nothing is lost where the process dies
    at any moment.

    run.yaml is on disk before anything moves, rows and events are passed to the
    operating system one by one, tables follow at the end, then result.yaml; the streams
    of rows go last. A disk that refuses while the run is under way raises Fault
    `record`.
    """

    def __init__(
        self,
        root: Path,
        header: Mapping[str, Any],
        frames: Keep = "key",
        *,
        patient: bool = False,
        film: Encoder | None = None,
    ) -> None:
        """Create a folder for a run below `root`, and write its `header` there.

        `patient` lets `frame` wait for the disk and belongs where the clock is virtual;
        `film` names the encoder of a film of all images. Raises ConfigurationError for
        a header that readers would refuse or a folder that cannot be written.
        """
        self._newest = float("nan")
        self._mark = False
        self._finished = False
        self._header: dict[str, Any] = {"schema": SCHEMA, **header}
        strip = parse(self._header, Header, RUN).strip

        try:
            self.folder = _new_folder(root, strip)
            write_document(self.folder / RUN, self._header)
            with ExitStack() as opened:
                self._open_streams(opened)
                self._frames = FrameWriter(
                    folder=self.folder, keep=frames, patient=patient, encoder=film
                )
                opened.pop_all()
        except OSError as error:
            raise ConfigurationError(
                f"{root}: runs cannot be recorded here: {error.strerror}; "
                "name another folder with --runs or make room"
            ) from None

    def _open_streams(self, opened: ExitStack) -> None:
        """Open the files to which rows and events are written, to be closed with
        `opened`, and lock that of the events.
        """
        self._events = opened.enter_context(new_file(self.folder / EVENTS))
        fcntl.flock(self._events, fcntl.LOCK_EX)
        self._ticks = tables.StreamFile(self.folder / TICK_STREAM, tables.TICK_ROWS)
        opened.callback(self._ticks.close)
        self._sights = tables.StreamFile(self.folder / SIGHT_STREAM, tables.SIGHT_ROWS)
        opened.callback(self._sights.close)

    def describe(self, **facts: Any) -> None:
        """Add `facts`, which were not known at the start of the run, to its header once
        it has ended.

        A document that is on disk costs more than a turn of the control loop has.
        """
        self._header |= facts

    def tick(self, arm: ArmState, state: str, *, closed: bool = True) -> None:
        """Write the row of one turn of the control loop: the measured `arm`, the
        `state` of the run, and whether the hand was told to be closed.
        """
        commanded = arm.commanded
        pose = arm.pose
        f_x, f_z = arm.force
        row = {
            "t": arm.stamp,
            "x": pose.x,
            "z": pose.z,
            "pitch": pose.pitch,
            "x_cmd": commanded.x,
            "z_cmd": commanded.z,
            "pitch_cmd": commanded.pitch,
            "hand_cmd": float(closed),
            "f_x": f_x,
            "f_z": f_z,
            "image_age": arm.stamp - self._newest,
            "state": state,
        }
        with self._recording():
            self._ticks.append(row)

    def sight(self, measurement: StripMeasurement) -> None:
        """Write the `measurement` of the strip in one camera image."""
        self._newest = measurement.stamp
        with self._recording():
            self._sights.append(sight_row(measurement))

    def frame(self, frame: Frame) -> None:
        """Hand over a camera image to be stored; its pixels must not change
        afterwards.
        """
        with self._recording():
            self._frames.put(frame, self._mark)
        self._mark = False

    def event(self, t: float, kind: str, **facts: Any) -> None:
        """Write an event of this `kind` at the time `t` [s] on the clock of the cell;
        after a fault the next image is marked.
        """
        self._mark = self._mark or kind == "fault"
        with self._recording():
            write_all(self._events, json_line({"t": t, "kind": kind, **facts}))

    def joints(self, rows: Array, origin: float) -> None:
        """Write what a robot has measured of its joints, in `rows` of shape (n, 29),
        with the run's time beginning at `origin` [s].

        Columns are t [s], then q, dq, q_d, tau_J of seven joints [rad, rad/s, rad, N
        m].
        """
        with self._recording():
            tables.write_parquet(self.folder / JOINTS, tables.joint_table(rows, origin))

    def finish(self, result: Mapping[str, Any]) -> None:
        """Close the files of rows, write the tables of the run and, as the last file,
        its `result`; a second call does nothing.

        Raises ConfigurationError for a result that readers would refuse.
        """
        if self._finished:
            return

        content = {"schema": SCHEMA, **result}
        parse(
            {key: value for key, value in content.items() if value is not None},
            Result,
            RESULT,
        )
        with self._recording():
            self._close_streams()

        folder = self.folder
        failure = self._frames.film_failure
        if failure:
            self.describe(film=failure)

        with self._recording():
            write_document(folder / RUN, self._header)
            tables.write_tables(folder, tables.assemble(folder))
            write_document(folder / RESULT, content)
            for stream in (TICK_STREAM, SIGHT_STREAM):  # all rows are in the tables
                (self.folder / stream).unlink(missing_ok=True)

        self._finished = True
        self._events.close()

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """Context in which the run counts as under way, even once it is finished and
        closed.

        A second handle of the locked file: nobody deletes or reads half of it, unless
        we die.
        """
        handle = os.dup(self._events.fileno())
        try:
            yield
        finally:
            os.close(handle)

    def close(self) -> None:
        """Close the files of the run; where it was not finished before, it counts as
        died.
        """
        with self._recording():
            try:
                self._close_streams()
                if not self._finished:
                    write_document(self.folder / RUN, self._header)
            finally:
                self._events.close()

    def _close_streams(self) -> None:
        self._frames.close()
        self._ticks.close()
        self._sights.close()

    @contextmanager
    def _recording(self) -> Iterator[None]:
        """Context in which an error of writing, here or in the thread that writes
        images, becomes a Fault named `record`.
        """
        try:
            yield
            failure = self._frames.take_failure()
        except OSError as error:
            failure = error
        if failure is not None:
            reason = failure.strerror or str(failure)
            raise Fault(
                "record",
                f"{self.folder}: {reason}; the run cannot be recorded any more",
            )


def sight_row(measurement: StripMeasurement) -> dict[str, Any]:
    """Row for the table of measurements in images, by column, from the `measurement` of
    the strip in one image.
    """
    row = asdict(measurement)
    row["tip_x"], row["tip_z"] = row.pop("tip")
    row["profile_x"], row["profile_z"] = row.pop("profile").T
    return row


def _new_folder(root: Path, strip: str) -> Path:
    """New folder below `root` whose name holds the present time and the name of the
    `strip`; OSError where none can be made.
    """
    root.mkdir(parents=True, exist_ok=True)
    moment = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    while True:
        folder = root / f"{moment}-{strip}-fold-{secrets.token_hex(2)}"
        with suppress(FileExistsError):
            folder.mkdir()
            return folder
