"""Child processes of the test process, found by `ps`, and folds in processes of their
own.
"""

import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path


def children(name: str) -> list[int]:
    """IDs of the `drivers.base.child` processes of this one whose main function's name
    has
    `name`.
    """
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat, command = (
                (folder / "stat").read_text(),
                (folder / "cmdline").read_text(),
            )
        except OSError:
            continue
        parent = int(stat.rpartition(")")[2].split()[1])
        words = command.split("\0")
        if (
            parent == os.getpid()
            and "drivers.base.child" in command
            and name in words[-2]
        ):
            found.append(int(folder.name))
    return found


def holds(claim: Callable[[], bool]) -> bool:
    """Whether the `claim` becomes true within two minutes."""
    patience = time.monotonic() + 120
    while not claim() and time.monotonic() < patience:
        time.sleep(0.01)
    return claim()


def wait_for_state(state: str, runs: Path, process: subprocess.Popen) -> Path:
    """Folder of the run, once it has entered `state`."""
    end = time.monotonic() + 300
    while time.monotonic() < end and process.poll() is None:
        for events in runs.glob("*/events.jsonl"):
            if f'"{state}"' in events.read_text():
                return events.parent
        time.sleep(0.02)
    raise AssertionError(f"no fold began: {process.communicate()}")
