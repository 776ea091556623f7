"""Disk cache of simulations, from which an interrupted fit resumes.

A fit asks for the same simulations in the same order whenever its inputs are the same. Each
round of answers is written as it comes; started again, rounds are read back while what is asked
equals what was asked then, bit for bit.
"""

import hashlib
import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cell.gap.fitting.tasks import Simulate
from cell.gap.subject.subject import Request, Residuals, Run
from drivers.files import writing


class SimulationCache:
    """Simulation function that stores its results in `folder`; `total` counts the simulations.

    The cache owns the folder's parent, too: `erase` deletes it.
    """

    def __init__(self, simulate: Simulate, folder: Path) -> None:
        self._simulate = simulate
        self._folder = folder
        self._round = 0
        self.total = 0
        folder.mkdir(parents=True, exist_ok=True)

    def __call__(self, requests: Sequence[Request]) -> list[Residuals]:
        """Residuals of `requests`, read from the cache where it holds them, else simulated."""
        path = self._folder / f"{self._round:05d}.npz"
        self._round += 1
        self.total += len(requests)
        asked = digest(requests)
        answers = _read(path, asked)
        if answers is None:
            answers = list(self._simulate(requests))
            _write(path, asked, answers)
        return answers

    def erase(self) -> None:
        """Delete the cache once the fit is complete."""
        shutil.rmtree(self._folder.parent, ignore_errors=True)


def digest(requests: Sequence[Request]) -> str:
    """Hash of the requested simulations and of the corrections made to their runs."""
    content = hashlib.sha256()
    runs = {id(r.run): r.run for r in requests}
    corrections = {key: _correction_hash(run) for key, run in runs.items()}
    for r in requests:
        content.update(r.run.name.encode() + corrections[id(r.run)])
        content.update(r.base.tobytes())
        for name in sorted(r.effects):
            content.update(name.encode() + r.effects[name].tobytes())
        content.update(r.local.tobytes() + bytes([r.rough]))
    return content.hexdigest()


def _correction_hash(run: Run) -> bytes:
    """Hash of what a correction of a run changes: its floors and its common errors."""
    h = hashlib.sha256(run.samples.floor.tobytes())
    for name in sorted(run.common):
        h.update(name.encode() + run.common[name].tobytes())
    return h.digest()


def _read(path: Path, asked: str) -> list[Residuals] | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            if str(stored["asked"]) != asked:
                return None
            edges = np.cumsum(stored["counts"])[:-1]
            means, squares = np.split(stored["mean"], edges), np.split(stored["square"], edges)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError):
        return None
    return [Residuals(m, s) for m, s in zip(means, squares, strict=True)]


def _write(path: Path, asked: str, answers: Sequence[Residuals]) -> None:
    partial = path.with_suffix(".part")
    with writing(path, "make room, leave the folder where it is, and run the command again"):
        _save(partial, asked, answers)
        partial.replace(path)


def _save(path: Path, asked: str, answers: Sequence[Residuals]) -> None:
    with path.open("wb") as file:
        np.savez(
            file,
            asked=np.array(asked),
            counts=np.array([len(a.mean) for a in answers]),
            mean=np.concatenate([a.mean for a in answers]),
            square=np.concatenate([a.square for a in answers]),
        )
