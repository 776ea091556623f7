"""Live view of a run in the viewer Rerun, drawn in a thread of its own."""

import math
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from calibration.calibration import load_calibration
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.record.events import row_of
from cell.record.files import CALIBRATION, RECORDING
from cell.report.viz.playback import PICTURE_PERIOD, LogLine, TickView
from cell.report.words import log_line
from drivers.base.errors import CellError
from drivers.base.types import Image
from drivers.strip.file import StripFile
from policies.policy import FoldPrediction

# items and images in the queue: at most 45 MB of images
WAITING, IMAGES_WAITING = 1024, 16
CLOSING_TIMEOUT = 30.0  # s to draw the queue after the run


class LiveView:
    """Observer of a run that shows it in Rerun without blocking it; drops old ticks
    when it lags.

    It writes run.rrd into the run's folder, serves it on loopback and opens a viewer
    there. The viewer connects to us, so that one that hangs or dies cannot block
    anything.
    `failure` is the reason why nothing is recorded any more, which the fold's warning
    states.
    """

    def __init__(
        self, folder: Path, strip: StripFile, *, hanging: bool = False
    ) -> None:
        """Show a run live; the calibration in its folder gives images their overlays.

        Measured time begins with the lift, or with the fold in a run that starts
        `hanging`.
        """
        self.failure = ""
        # drops the oldest one
        self._waiting: deque[TickView | LogLine] = deque(maxlen=WAITING)
        self._news = threading.Event()
        self._over = threading.Event()
        self._first_measured = State.FOLD if hanging else State.LIFT
        self._origin = math.nan
        self._ticks = 0
        self._next_image = -math.inf  # s, when the next image may be shown
        self._sequence = -1  # number of the newest measured image
        self._predicted: FoldPrediction | None = None
        self._thread = threading.Thread(
            target=self._draw_queue, args=(folder, strip), name="viz", daemon=True
        )
        self._thread.start()

    def handle_tick(self, snapshot: Snapshot) -> None:
        """Queue the state of the cell at a tick for drawing."""
        predicted = snapshot.predicted
        measurement = snapshot.view.measurement
        if measurement is not None and measurement.sequence == self._sequence:
            measurement = None
        if measurement is not None:
            self._sequence = measurement.sequence
        outlook = None
        if predicted is not None and predicted is not self._predicted:
            outlook = row_of(asdict(predicted))
        self._predicted = predicted
        self._ticks += 1
        self._put(
            TickView(
                clock=snapshot.time,
                t=snapshot.time - self._origin,
                tick=self._ticks,
                state=str(snapshot.state),
                pose=snapshot.arm.pose.as_array(),
                measurement=measurement,
                image=self._image(snapshot),
                outlook=outlook,
            )
        )

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Queue an event of the run for drawing, at `time` [s] of the cell's clock."""
        if kind == "state" and facts.get("state") == self._first_measured:
            self._origin = time
        self._put(
            LogLine(time, log_line(kind, facts), kind == "fault", time - self._origin)
        )

    def close(self, timeout: float = CLOSING_TIMEOUT) -> None:
        """Wait at most `timeout` [s] until all queued ticks are drawn; allowed
        twice.
        """
        self._over.set()
        self._news.set()
        self._thread.join(timeout)

    def _image(self, snapshot: Snapshot) -> Image | None:
        """Newest image (h, w, 3) of `snapshot`, if one is due and drawing keeps up;
        else None.
        """
        frame = snapshot.view.frame
        if not snapshot.view.fresh or frame is None or snapshot.time < self._next_image:
            return None
        self._next_image = snapshot.time + PICTURE_PERIOD
        waiting = (item for item in self._waiting.copy() if isinstance(item, TickView))
        late = sum(item.image is not None for item in waiting) >= IMAGES_WAITING
        return None if late else frame.image

    def _put(self, item: TickView | LogLine) -> None:
        """Queue `item` for drawing."""
        if self._thread.is_alive():
            self._waiting.append(item)
            self._news.set()

    def _draw_queue(self, folder: Path, strip: StripFile) -> None:
        """Draw the queue until the run is over; Rerun is imported here, during the
        run.
        """
        waiting = self._waiting
        from cell.record.run import read_broken_run
        from cell.report.viz.opening import open_recording
        from cell.report.viz.recording import RerunWriter, layout

        path, target = folder / CALIBRATION, folder / RECORDING
        try:
            calibration = load_calibration(path) if path.exists() else None
            views = layout(strip, calibration, live=True)
            with open_recording("cell", target, views, live=True) as recording:
                screen = RerunWriter(recording, calibration, strip)
                screen.begin(read_broken_run(folder))
                while waiting or not self._over.is_set():
                    self._news.wait()
                    self._news.clear()
                    while waiting:
                        screen.draw(waiting.popleft())
                screen.finish(read_broken_run(folder))
        except (CellError, OSError, RuntimeError, ValueError) as error:
            self.failure = f"the view is not recorded any more: {error}"
            waiting.clear()


@contextmanager
def watching(
    folder: Path, strip: StripFile, *, live: bool, hanging: bool = False
) -> Iterator[tuple[LiveView, ...]]:
    """Observers that show the fold in `folder` in Rerun within the block; none unless
    `live`.
    """
    if not live:
        yield ()
        return
    view = LiveView(folder, strip, hanging=hanging)
    try:
        yield (view,)
    finally:
        view.close()
