"""Names of the files in a run's folder, and whether a run is complete or under way."""

import fcntl
import os
from pathlib import Path
from typing import Literal

from drivers.base.errors import ConfigurationError

RUN, RESULT, EVENTS, TRUTH = "run.yaml", "result.yaml", "events.jsonl", "truth.yaml"
TICKS, PROFILE, SIGHTS = "ticks.parquet", "profile.parquet", "sights.parquet"
SIGNALS, ANGLES = "signals.parquet", "angles.parquet"  # of a mechanism, of a pendulum
JOINTS = "joints.parquet"  # of a robot, tick by tick, from before the lift on
TICK_STREAM, SIGHT_STREAM = "ticks.arrows", "sights.arrows"
CALIBRATION, RECORDING, REPORT = "calibration.yaml", "run.rrd", "report.html"
# of the camera, for eyes; frames/index.jsonl states the time of each image
FILM = "film.mp4"
OVERLAY = "overlay.mp4"  # of a film that was observed
CHECKPOINT = "checkpoint.json"
NOTES = "notes.yaml"  # tags and a note by the operator
# of a series of runs: in a folder of its own, or the end of its name beside other runs
MANIFEST = "manifest.jsonl"

Keep = Literal["all", "key", "none"]  # which images of a run are kept


def is_run(folder: Path) -> bool:
    """Whether `folder` holds a run, be it complete or not; False where the folder
    cannot be read.
    """
    return os.path.isfile(folder / RUN)  # noqa: PTH113  which raises nothing


def runs_in(folder: Path) -> list[Path]:
    """The folder itself if it holds a run, or else the run folders directly in it,
    sorted by name; empty where there are none.
    """
    if is_run(folder):
        return [folder]
    return sorted(path for path in folder.glob("*") if is_run(path))


def runs_below(folder: Path) -> list[Path]:
    """Run folders in `folder`, and in those of its subfolders that are no runs
    themselves, sorted by path.
    """
    return [run for entry in sorted(folder.iterdir()) for run in runs_in(entry)]


def run_folder(text: str) -> Path:
    """Folder of the run that `text` names, by its path, by the end of its name, or by
    the word `last`.

    The latter two are looked for in each folder here and below ./runs, the newest of
    several is meant; what is not found there stays a path.
    """
    path = Path(text)
    if path.exists() or len(path.parts) != 1 or not text.isalnum():
        return path
    name = f"[0-9]*Z-*{'' if text == 'last' else text}/{RUN}"
    found = [
        file.parent
        for pattern in ("*", "runs/*")
        for file in Path().glob(f"{pattern}/{name}")
    ]
    return max(found, key=lambda run: run.name, default=path)


def check_run(folder: Path) -> None:
    """Raise ConfigurationError where `folder` holds no run; the message suggests a run
    inside it, if there is one.
    """
    if is_run(folder):
        return
    if not folder.exists():
        raise ConfigurationError(
            f"{folder}: is not there; see `cell runs`, or give its path"
        )
    if not folder.is_dir():
        parent = f", {folder.parent}" if is_run(folder.parent) else ""
        raise ConfigurationError(
            f"{folder}: is a file, a run is a folder; give the folder{parent}"
        )

    hint = "".join(
        f"; name one of those in it, as {inner}" for inner in runs_in(folder)[-1:]
    )
    raise ConfigurationError(f"{folder}: is not a run: it holds no {RUN}{hint}")


def is_under_way(folder: Path) -> bool:
    """Whether a living process is still writing the run in `folder`, which its lock on
    a file there shows.
    """
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
