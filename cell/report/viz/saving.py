"""Writing of a Rerun recording to a file such that a full disk cannot block the process."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import rerun as rr
from rerun import bindings

from drivers.files import open_emptied, write_all

CHUNK_SIZE = 1 << 20  # bytes per write


@contextmanager
def saving(recording: rr.RecordingStream, path: Path, *others: Any) -> Iterator[None]:
    """Write `recording` to the file at `path`, complete after the block, and send it to `others`.

    Raises OSError where the file cannot be written. `others` are sinks of Rerun. A file that
    Rerun writes itself makes it wait for good, and the process with it, once the disk is full; so
    it writes into a pipe, from which a thread of this process writes the file.
    """
    # A recording that nobody holds keeps two threads and 0.5 MB until this, which `rr.init` calls.
    bindings.flush_and_cleanup_orphaned_recordings()
    with open_emptied(path) as file:
        end, begin = os.pipe()
        failures: list[OSError] = []
        thread = threading.Thread(
            target=_pass_on, args=(end, file, failures), name="recording", daemon=True
        )
        thread.start()
        try:
            recording.set_sinks(rr.FileSink(f"/proc/self/fd/{begin}"), *others)
            yield
        finally:
            recording.disconnect()
            os.close(begin)
            thread.join()
            os.close(end)
    if failures:
        raise failures[0]


def send_blueprint(recording: rr.RecordingStream, blueprint: Any) -> None:
    """Send the viewer's layout `blueprint` to the Rerun `recording`, and free its memory.

    `RecordingStream.send_blueprint` does the same, but Rerun 0.41 keeps the stream that it makes of
    the layout, with two threads and 0.8 MB, for as long as the process lives.
    """
    layout = rr.RecordingStream._from_native(
        bindings.new_blueprint(recording.get_application_id(), False, False, True)
    )
    layout.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(layout)
    storage = layout.memory_recording().storage
    bindings.send_blueprint(storage, True, True, recording=recording.to_native())
    bindings.disconnect(recording=layout.to_native())


def _pass_on(pipe: int, file: FileIO, failures: list[OSError]) -> None:
    """Write the bytes from `pipe` into `file`; an OSError is appended to `failures`."""
    # after a failure bytes are read and discarded: a full pipe would block its writer for good
    while content := os.read(pipe, CHUNK_SIZE):
        try:
            if not failures:
                write_all(file, content)
        except OSError as error:
            failures.append(error)
