"""Rerun recordings: written to a file such that a full disk cannot block the process,
served live, and laid out.
"""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings
from rerun.blueprint.components import LoopMode, PlayState

from cell.base.config.places import cache_folder
from cell.report.viz.watch import VIEWER_PORT, has_screen
from drivers.base.files import replace_file
from drivers.base.types import Image

VIEWER_MEMORY, SERVER_MEMORY = "2GB", "256MB"


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


@contextmanager
def open_recording(
    application: str, path: Path, layout: rrb.Blueprint, *, live: bool = False
) -> Iterator[rr.RecordingStream]:
    """Open a Rerun recording with a `layout` in the file at `path`; complete after the
    block.

    `live` also serves it on loopback and, where there is a screen, starts Rerun's
    viewer there. Raises OSError, RuntimeError or ValueError where the file cannot be
    written.
    """
    recording = rr.RecordingStream(
        application, recording_id=ascii(path.parent.name).strip("'")
    )
    servers = []
    if live:
        memory = SERVER_MEMORY
        servers = [
            rr.GrpcServerSink("127.0.0.1", free_port(), server_memory_limit=memory)
        ]
    with saving(recording, path, *servers):
        for server in servers if has_screen() else ():
            with suppress(OSError):  # without a viewer the file is still written
                open_viewer(server.uri)
        send_blueprint(recording, layout)
        yield recording


def open_viewer(address: str) -> None:
    """Start Rerun's viewer on `address` as an independent process that reports no
    usage.
    """
    command = [sys.executable, "-m", "rerun_cli"]
    quiet: dict[str, Any] = dict.fromkeys(
        ("stdin", "stdout", "stderr"), subprocess.DEVNULL
    )
    quiet["env"] = {**os.environ, "XDG_CONFIG_HOME": str(cache_folder() / "viewer")}
    subprocess.run([*command, "analytics", "disable"], check=False, **quiet)  # noqa: S603  ours
    arguments = ("--connect", address, "--memory-limit", VIEWER_MEMORY)
    subprocess.Popen([*command, *arguments], start_new_session=True, **quiet)  # noqa: S603  ours


def free_port() -> int:
    """Number of a free TCP port on the loopback: that on which a viewer looks, if it
    is.
    """
    for wanted in (VIEWER_PORT, 0):
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", wanted))
            return int(probe.getsockname()[1])
    return VIEWER_PORT


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


def curves(origin: str, name: str, *, axis: Any = None, left: bool = False) -> Any:
    """View of the curves under `origin`, with its legend in the right corner or the
    `left`.
    """
    corner = rrb.Corner2D.LeftTop if left else rrb.Corner2D.RightTop
    return rrb.TimeSeriesView(
        origin=origin, name=name, plot_legend=rrb.PlotLegend(corner=corner), axis_x=axis
    )


def document(text: str) -> Any:
    """Text in Markdown."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def jpeg(image: Image, width: int | None = None) -> bytes:
    """Compress `image` (h, w, 3) BGR as a JPEG, `width` [px] wide if it is given."""
    if width is not None:
        size = (width, round(image.shape[0] * width / image.shape[1]))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 70])
    return bytes(content)
