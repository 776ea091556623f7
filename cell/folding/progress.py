"""Progress of a fold on one terminal line: state, gripper, measurements."""

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.status import Status

from cell.orchestrator.run import Observer
from cell.orchestrator.snapshot import Snapshot

TICKS_BETWEEN_LOOKS = 10  # ticks between two looks


class ProgressLine:
    """Observer that shows a run on one line of the terminal."""

    def __init__(self, status: Status, strip: str) -> None:
        self._status = status
        self._strip = strip
        self._count = 0

    def see(self, snapshot: Snapshot) -> None:
        """Show every TICKS_BETWEEN_LOOKS-th tick."""
        self._count += 1
        if self._count % TICKS_BETWEEN_LOOKS:
            return
        pose = snapshot.arm.pose
        text = f"{self._strip}  {snapshot.state:<9} {snapshot.time:5.1f} s"
        text += f"   gripper x {1e3 * pose.x:4.0f}  z {1e3 * pose.z:4.0f} mm"
        seen = snapshot.view.measurement
        if seen is not None and math.isfinite(seen.contact_x):
            text += f"   desk contact {1e3 * seen.contact_x:4.0f} mm"
        self._status.update(text)

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Print a fault on a line of its own, which stays; other events are not shown."""
        if kind == "fault":
            text = f"{time:.2f} s  {facts['name']}: {facts['reason']}"
            self._status.console.print(text, markup=False, soft_wrap=True)


@contextmanager
def progress(strip: str) -> Iterator[tuple[Observer, ...]]:
    """Observers that show the progress of a fold of `strip`; none without a terminal."""
    if not sys.stderr.isatty():
        yield ()
        return
    with Console(stderr=True).status("opening the cell") as status:
        yield (ProgressLine(status, strip),)
