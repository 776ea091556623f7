"""A recording in Rerun is whole, or says that its file cannot be written; nothing waits
for it.
"""

import subprocess
import sys

import numpy as np
import rerun as rr
from rerun.chunk import RrdReader

from cell.report.viz.saving import saving

FULL = """
import resource, signal, sys
from pathlib import Path
import numpy as np, rerun as rr
from cell.report.viz.saving import saving
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
recording, noise = rr.RecordingStream("cell"), np.random.default_rng(0)
try:
    with saving(recording, Path(sys.argv[1])):
        for number in range(40):
            recording.set_time("t", sequence=number)
            recording.log("image", rr.Image(noise.integers(0, 255, (200, 200, 3), np.uint8)))
        recording.disconnect()
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, 1 << 16))
except OSError as error:
    print("refused:", error)
"""


def test_process_ends_where_the_file_cannot_grow(tmp_path):
    words = [sys.executable, "-c", FULL, str(tmp_path / "run.rrd")]
    done = subprocess.run(
        words, capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout == "refused: [Errno 27] File too large\n"


def test_what_was_logged_is_in_the_file(tmp_path):
    recording, path = (
        rr.RecordingStream("cell", recording_id="some"),
        tmp_path / "run.rrd",
    )
    path.write_bytes(bytes(1 << 20))  # of an earlier one, which is longer
    with saving(recording, path):
        for number in range(100):
            recording.set_time("t", sequence=number)
            recording.log("value", rr.Scalars(np.sin(number)))
    rows = [
        chunk.num_rows
        for chunk in RrdReader(path).stream().to_chunks()
        if str(chunk.entity_path) == "/value"
    ]
    assert sum(rows) == 100
