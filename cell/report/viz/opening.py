"""Opening of a Rerun recording: in a file and, live, before the eyes of a viewer."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from cell.base.config.places import cache_folder
from cell.report.viz.saving import saving, send_blueprint

VIEWER_PORT = 9876  # at which a viewer looks by itself
NO_SCREEN = (
    "no screen here (DISPLAY and WAYLAND_DISPLAY are empty), so no viewer opens; look"
    f" from another machine: `ssh -L {VIEWER_PORT}:127.0.0.1:{VIEWER_PORT} HOST`, then"
    " `rerun --connect` there; or open the recording afterwards"
)
VIEWER_MEMORY, SERVER_MEMORY = "2GB", "256MB"


def has_screen() -> bool:
    """Whether a window can be shown here."""
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


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
            rr.GrpcServerSink("127.0.0.1", _free_port(), server_memory_limit=memory)
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


def _free_port() -> int:
    """Number of a free TCP port on the loopback, preferably the one at which a viewer
    looks.
    """
    for wanted in (VIEWER_PORT, 0):
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", wanted))
            return int(probe.getsockname()[1])
    return VIEWER_PORT
