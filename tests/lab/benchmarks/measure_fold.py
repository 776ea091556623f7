"""Processor time and disk of a warm fold, beside those of another commit.

python -m tests.lab measure-fold REVISION [--folds 5] [--strip denim]

The two fold in turn, each after one fold that nobody counts. Both run with this
environment's packages; the other commit's sources are laid out beside.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Annotated

import typer

HERE = Path(__file__).parents[3]
TIME_LIMIT = 900  # s of a fold


def main(
    revision: Annotated[str, typer.Argument(help="Commit to compare with.")],
    folds: Annotated[int, typer.Option(min=1, help="Folds of each.")] = 5,
    strip: str = "denim",
) -> None:
    """Fold in turn with this tree and with REVISION, and print the medians of both."""
    with tempfile.TemporaryDirectory() as name:
        other = Path(name) / "other"
        subprocess.run(["git", "worktree", "add", "-q", other, revision], check=True)
        try:
            sources = {"this tree": HERE, revision: other}
            found = {label: list[tuple[float, float]]() for label in sources}
            for number in range(folds + 1):
                for label, tree in sources.items():
                    runs = Path(name) / f"{number}-{len(label)}"
                    measured = fold_once(tree, strip, runs)
                    found[label] += [measured] * (number > 0)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", other], check=True)
    for label, numbers in found.items():
        seconds, megabytes = map(median, zip(*numbers, strict=True))
        print(f"{label}: {seconds:.1f} s of processor, {megabytes:.1f} MB a fold")


def fold_once(tree: Path, strip: str, runs: Path) -> tuple[float, float]:
    """Processor time [s] and size [MB] of a fold with the sources in `tree`."""
    before = os.times()
    subprocess.run(
        [sys.executable, "-m", "cell", "fold", "--strip", strip, "--runs", runs],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        timeout=TIME_LIMIT,
        check=True,
    )
    after = os.times()
    used = after.children_user + after.children_system
    used -= before.children_user + before.children_system
    size = sum(path.stat().st_size for path in runs.rglob("*") if path.is_file())
    return used, 1e-6 * size
