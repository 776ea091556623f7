"""What the first quarter of an hour costs: install, first fold, second fold, second checkout.

python -m tests.lab first-quarter

The last commit is checked out into a temporary folder with a home of its own, where README's first
command is carried out as a newcomer types it. Processor time is that of a command and its children;
other loads stretch it, too, so compare rows of one run.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[3]
INSTALL = ("-m", "pip", "install", "-q", "--no-compile", "-c", ".ci/constraints.txt", "-e", ".")
FOLD = ("-m", "cell", "fold", "--strip", "denim")


class Cost(NamedTuple):
    """Processor time, wall time and that to the first line printed [s], and files compiled."""

    processor: float
    wall: float
    line: float
    kernels: int

    def row(self, part: str) -> str:
        """Row of the table about this `part`."""
        line = "" if self.line == self.wall else f"{self.line:8.1f}"
        return f"{part:16s} {self.processor:11.1f} {self.wall:8.1f} {line:8s} {self.kernels:8d}"


def main() -> int:
    """Install and fold in a temporary folder, and print a row for each part."""
    with tempfile.TemporaryDirectory() as place:
        home, first, second = (Path(place) / name for name in ("home", "first", "second"))
        for checkout in (first, second):
            subprocess.run(["git", "clone", "-q", ROOT, checkout], check=True)
        python = first / ".venv" / "bin" / "python"
        print(f"{'':16s} processor s   wall s  to line compiled")
        print(carried_out([sys.executable, "-m", "venv", ".venv"], first, home).row("venv"))
        print(carried_out([python, *INSTALL], first, home).row("install"), flush=True)
        for part, checkout in (
            ("first fold", first),
            ("second fold", first),
            ("second checkout", second),
        ):
            print(carried_out([python, *FOLD], checkout, home).row(part), flush=True)
        files = (path.stat().st_size for path in python.parents[1].rglob("*") if path.is_file())
        print(f"installed {1e-6 * sum(files):.0f} MB")
    return 0


def carried_out(command: list[str | Path], folder: Path, home: Path) -> Cost:
    """Cost of `command` in `folder` with its caches in `home`; raises where it fails."""
    before, begun, compiled = _processor(), time.monotonic(), _kernels(home)
    caches = {"HOME": home, "XDG_CACHE_HOME": home / "cache", "PYTHONPATH": folder}
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    told = None
    with subprocess.Popen(
        command, cwd=folder, env={**kept, **caches}, stdout=subprocess.PIPE
    ) as process:
        for _ in process.stdout:
            told = told or time.monotonic() - begun
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    wall = time.monotonic() - begun
    return Cost(_processor() - before, wall, told or wall, _kernels(home) - compiled)


def _processor() -> float:
    """Processor time [s] of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _kernels(home: Path) -> int:
    return sum(1 for _ in home.rglob("*.nbc"))
