"""File names in a run folder, and detection of a run under way."""

import fcntl
from pathlib import Path

RUN, RESULT, EVENTS, TRUTH = "run.yaml", "result.yaml", "events.jsonl", "truth.yaml"
TICKS, PROFILE, SIGHTS = "ticks.parquet", "profile.parquet", "sights.parquet"
JOINTS = "joints.parquet"  # of a robot, tick by tick, from before the lift on
TICK_STREAM, SIGHT_STREAM = "ticks.arrows", "sights.arrows"
CALIBRATION, RECORDING, REPORT = "calibration.yaml", "run.rrd", "report.html"
REBUILT = "rebuilt.rrd"  # by `cell viz`, beside the one of the fold itself
FILM = "film.mp4"  # of the camera, for eyes; frames/index.jsonl states the time of each image
OVERLAY = "overlay.mp4"  # of a film that was observed
CHECKPOINT = "checkpoint.json"
NOTES = "notes.yaml"  # tags and a note by the operator


def is_run(folder: Path) -> bool:
    """Whether `folder` holds a run, complete or not."""
    return (folder / RUN).is_file()


def is_under_way(folder: Path) -> bool:
    """Whether a living process is writing the run in `folder`: it holds a lock on the events."""
    if not (folder / EVENTS).is_file():  # a pipe would be waited for
        return False
    try:
        with (folder / EVENTS).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
