"""Rerun recordings: laid out, and written to a file such that a full disk cannot block
the process.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings
from rerun.blueprint.components import LoopMode, PlayState

from drivers.base.files import replace_file


@contextmanager
def saving(recording: rr.RecordingStream, path: Path, *others: Any) -> Iterator[None]:
    """Write `recording` to the file at `path` after the block, and send it to `others`
    meanwhile.

    Raises OSError where the file cannot be written. `others` are sinks of Rerun, which
    waits for good, and the process with it, once its file's disk is full: so its file
    lies in memory.
    """
    # A recording that nobody holds keeps two threads and 0.5 MB until this, which
    # `rr.init` calls.
    bindings.flush_and_cleanup_orphaned_recordings()
    with os.fdopen(os.memfd_create("recording"), "rb") as kept:
        try:
            recording.set_sinks(rr.FileSink(f"/proc/self/fd/{kept.fileno()}"), *others)
            yield
        finally:
            recording.disconnect()
            replace_file(path, kept.read())


def send_blueprint(recording: rr.RecordingStream, blueprint: Any) -> None:
    """Send the viewer's layout `blueprint` to the Rerun `recording`, and free its
    memory.

    `RecordingStream.send_blueprint` does the same, but Rerun 0.41 keeps the stream that
    it makes of the layout, with two threads and 0.8 MB, for as long as the process
    lives.
    """
    layout = rr.RecordingStream._from_native(
        bindings.new_blueprint(recording.get_application_id(), False, False, True)
    )
    layout.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(layout)
    storage = layout.memory_recording().storage
    bindings.send_blueprint(storage, True, True, recording=recording.to_native())
    bindings.disconnect(recording=layout.to_native())


def arrange(
    large: Any, picture: Any, words: Any, right: Sequence[Any], shares: Sequence[float]
) -> Any:
    """Views of one subject: on the left what is `large` over `picture` and `words`; on
    the `right` lanes, curves and log, with their `shares` of the height.
    """
    below = [each for each in (picture, words) if each is not None]
    lower = rrb.Horizontal(*below, column_shares=[1.5, 1][: len(below)])
    left = rrb.Vertical(large, lower, row_shares=[1.45, 1])
    column = rrb.Vertical(*right, row_shares=list(shares))
    return rrb.Horizontal(left, column, column_shares=[1.6, 1])


def blueprint(
    views: Any, *, timeline: str = "t", live: bool = False, fps: float | None = None
) -> rrb.Blueprint:
    """Layout of `views` without panels, which plays over and over; `live`, it shows the
    newest.

    A `timeline` of numbered steps plays `fps` of them a second.
    """
    play = PlayState.Following if live else PlayState.Playing
    loop = None if live else LoopMode.All
    return rrb.Blueprint(
        views,
        rrb.TimePanel(
            timeline=timeline,
            state="collapsed",
            play_state=play,
            loop_mode=loop,
            fps=fps,
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def curves(origin: str, name: str, *, axis: Any = None) -> Any:
    """View of the curves under `origin`, with its legend in the right corner."""
    corner = rrb.Corner2D.RightTop
    return rrb.TimeSeriesView(
        origin=origin, name=name, plot_legend=rrb.PlotLegend(corner=corner), axis_x=axis
    )


def document(text: str) -> Any:
    """Rerun document with `text` in Markdown."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
