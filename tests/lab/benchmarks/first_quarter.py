"""Measures the cost of a first session: install, first and second fold, second
checkout.

python -m tests.lab first-quarter

The last commit is checked out into a temporary folder with a home of its own, and
README's first command is carried out there as a newcomer types it. Other loads stretch
processor time, too: compare rows of one table.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
INSTALL = (
    "-m",
    "pip",
    "install",
    "-q",
    "--no-compile",
    "-c",
    ".ci/constraints.txt",
    "-e",
    ".",
)
FOLD = ("-m", "cell", "fold", "--strip", "denim")


def main() -> None:
    """Install and fold in a temporary folder, and print a row for each part."""
    print("processor s   wall s  to the line  kernels compiled")
    with tempfile.TemporaryDirectory() as place:
        home, first, second = (
            Path(place) / name for name in ("home", "first", "second")
        )
        python = first / ".venv" / "bin" / "python"
        for checkout in (first, second):
            subprocess.run(["git", "clone", "-q", ROOT, checkout], check=True)
        carry_out("venv", home, first, sys.executable, "-m", "venv", ".venv")
        carry_out("install", home, first, python, *INSTALL)
        carry_out("first fold", home, first, python, *FOLD)
        carry_out("second fold", home, first, python, *FOLD)
        carry_out("fold of a second checkout", home, second, python, *FOLD)
        files = (
            path.stat().st_size
            for path in python.parents[1].rglob("*")
            if path.is_file()
        )
        print(f"installed {1e-6 * sum(files):.0f} MB")


def carry_out(part: str, home: Path, folder: Path, *command: str | Path) -> None:
    """Carry out `command` in `folder` with its caches in `home`, and print what it
    cost.
    """
    before, begun, kernels, said = (
        processor(),
        time.monotonic(),
        count(home),
        float("nan"),
    )
    kept = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    kept |= {"HOME": home, "XDG_CACHE_HOME": home / "cache", "PYTHONPATH": folder}
    with subprocess.Popen(
        command, cwd=folder, env=kept, stdout=subprocess.PIPE
    ) as process:
        if process.stdout.readline():
            said = time.monotonic() - begun
        process.stdout.read()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    wall, made = time.monotonic() - begun, count(home) - kernels
    print(
        f"{processor() - before:11.1f} {wall:8.1f} {said:12.1f} {made:17d}  {part}",
        flush=True,
    )


def processor() -> float:
    """Processor time [s] of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def count(home: Path) -> int:
    """Number of compiled kernels in the cache of `home`."""
    return sum(1 for _ in home.rglob("*.nbc"))
