"""Writing of a Rerun recording to a file such that a full disk cannot block the
process.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rerun as rr
from rerun import bindings

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
