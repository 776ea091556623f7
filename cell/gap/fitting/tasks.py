"""Runs many fits in lock-step, and caches the simulations that they request on disk.

A task is a generator that yields requests and is sent their residuals; its result does not
depend on what runs beside it. A fit asks for the same simulations in the same order whenever its
inputs are the same. Each round of answers is written as it comes; started again, rounds are read
back while what is asked equals what was asked then, bit for bit.
"""

import hashlib
import shutil
import zipfile
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from cell.gap.subject.subject import Request, Residuals, Run
from drivers.files import writing

T = TypeVar("T")
Simulate = Callable[[Sequence[Request]], Sequence[Residuals]]
Task = Generator[list[Request], Sequence[Residuals], T]


def side_by_side(tasks: Sequence[Task[T]]) -> Task[list[T]]:
    """Join `tasks` into one task that advances them in lock-step and returns all their results."""
    results: dict[int, T] = {}
    waiting: dict[int, list[Request]] = {}

    def advance(i: int, answer: Sequence[Residuals] | None = None) -> None:
        try:
            waiting[i] = next(tasks[i]) if answer is None else tasks[i].send(answer)
        except StopIteration as stop:
            results[i] = stop.value

    for i in range(len(tasks)):
        advance(i)
    while waiting:
        order = list(waiting)
        answers = list((yield [r for i in order for r in waiting[i]]))
        for i in order:
            count = len(waiting.pop(i))
            advance(i, answers[:count])
            answers = answers[count:]
    return [results[i] for i in range(len(tasks))]


def run_one(simulate: Simulate, task: Task[T]) -> T:
    """Run a task to its end, answering its requests by `simulate`; returns its result."""
    return run_all(simulate, [task])[0]


def run_all(simulate: Simulate, tasks: Sequence[Task[T]]) -> list[T]:
    """Run `tasks` in lock-step, one call of `simulate` for each round; returns their results."""
    joint = side_by_side(tasks)
    answers: Sequence[Residuals] | None = None
    while True:
        try:
            requests = next(joint) if answers is None else joint.send(answers)
        except StopIteration as stop:
            results: list[T] = stop.value
            return results
        answers = simulate(requests)


class SimulationCache:
    """Simulation function that keeps its answers in files in `folder`; `total` counts simulations.

    `erase` deletes the folder's parent, too.
    """

    def __init__(self, simulate: Simulate, folder: Path) -> None:
        self._simulate = simulate
        self._folder = folder
        self._round = 0
        self.total = 0
        folder.mkdir(parents=True, exist_ok=True)

    def __call__(self, requests: Sequence[Request]) -> list[Residuals]:
        """Residuals of `requests`, from the file of this round if it holds the same ones."""
        path = self._folder / f"{self._round:05d}.npz"
        self._round += 1
        self.total += len(requests)
        key = digest(requests)
        answers = _read(path, key)
        if answers is None:
            answers = list(self._simulate(requests))
            _store_answers(path, key, answers)
        return answers

    def erase(self) -> None:
        """Delete the cached answers with their parent folder, after a complete fit."""
        shutil.rmtree(self._folder.parent, ignore_errors=True)


def digest(requests: Sequence[Request]) -> str:
    """Hash of simulation `requests`: runs, values, and the corrections made to the runs."""
    content = hashlib.sha256()
    runs = {id(r.run): r.run for r in requests}
    corrections = {key: _correction_hash(run) for key, run in runs.items()}
    for r in requests:
        content.update(r.run.name.encode() + corrections[id(r.run)])
        content.update(r.base.tobytes())
        for name in sorted(r.effects):
            content.update(name.encode() + r.effects[name].tobytes())
        content.update(r.local.tobytes() + bytes([r.response]))
    return content.hexdigest()


def _correction_hash(run: Run) -> bytes:
    """Hash of what a correction of a run changes: its floors and its common errors."""
    h = hashlib.sha256(run.samples.floor.tobytes())
    for name in sorted(run.common):
        h.update(name.encode() + run.common[name].tobytes())
    return h.digest()


def _read(path: Path, key: str) -> list[Residuals] | None:
    """Residuals stored at `path` for the requests of the hash `key`; None if it holds others."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            if str(stored["key"]) != key:
                return None
            edges = np.cumsum(stored["counts"])
            means, squares = (np.split(stored[part], edges)[:-1] for part in ("mean", "square"))
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError):
        return None
    return [Residuals(m, s) for m, s in zip(means, squares, strict=True)]


def _store_answers(path: Path, key: str, answers: Sequence[Residuals]) -> None:
    """Store the `answers`, maybe none, to requests of the hash `key`; the file appears whole."""
    partial = path.with_suffix(".part")
    with writing(path, "make room, leave the folder where it is, and run the command again"):
        with partial.open("wb") as file:
            np.savez(
                file,
                key=np.array(key),
                counts=np.array([len(a.mean) for a in answers], dtype=np.int64),
                mean=np.concatenate([np.zeros(0), *(a.mean for a in answers)]),
                square=np.concatenate([np.zeros(0), *(a.square for a in answers)]),
            )
        partial.replace(path)
