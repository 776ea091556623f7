"""Campaign on this machine: parts measured side by side in processes."""

import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path

from cell.campaign.journal import Record
from cell.campaign.run import Part, measure, prepare, set_aside
from cell.campaign.worker import Worker
from drivers.child import ChildDied
from drivers.errors import CellError

POLL_INTERVAL = 0.2  # s between looks at the clock
TRIES = 2  # of a part that kills its process: the first may have been the machine's fault


@dataclass(frozen=True, slots=True)
class Local:
    """Engine of `jobs` processes; a part may take `limit` [s] of wall time, any time where None."""

    jobs: int = 1
    limit: float | None = None

    def measure(
        self, parts: Sequence[Part], folder: Path, versions: Mapping[str, str]
    ) -> Iterator[Record]:
        """Yield the records of `parts` as they finish; raises CellError if one cannot be stored."""
        crew = Crew(min(self.jobs, len(parts)))
        try:
            yield from crew.records(parts, folder, versions, self.limit)
        finally:
            crew.close()


@dataclass(slots=True)
class Task:
    """Part in the process of `worker`, `begun` at that time [s], None while the process starts."""

    part: Part
    worker: Worker
    begun: float | None


class Crew:
    """Pool of up to `size` processes, kept from one call to the next."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._idle: list[Worker] = []
        self._busy: list[Task] = []

    def records(
        self, parts: Sequence[Part], folder: Path, versions: Mapping[str, str], limit: float | None
    ) -> Iterator[Record]:
        """Yield the record of every part, in the order in which they finish.

        A part that outlives its `limit` [s], or kills its process twice, is set aside. Raises
        CellError where a record cannot be stored.
        """
        waiting, deaths = deque(parts), Counter[str]()
        while waiting or self._busy:
            while waiting and len(self._busy) < self._size:
                self._start(waiting.popleft(), folder, versions)
            ready = wait([task.worker.pipe for task in self._busy], POLL_INTERVAL)
            for task in list(self._busy):
                part, found = task.part, self._look(task, limit, ready=task.worker.pipe in ready)
                if isinstance(found, ChildDied):
                    deaths[part.key] += 1
                    if deaths[part.key] < TRIES:
                        waiting.append(part)
                        continue
                    found = f"its process died {TRIES} times: {found}"
                if isinstance(found, str):
                    found = set_aside(part, found, folder, versions)
                if found is not None:
                    yield found

    def close(self) -> None:
        """End all processes, idle or not; finished parts are in the journal."""
        for worker in (*self._idle, *(task.worker for task in self._busy)):
            worker.kill()
        self._idle, self._busy = [], []

    def _start(self, part: Part, folder: Path, versions: Mapping[str, str]) -> None:
        if self._idle:
            task = Task(part, self._idle.pop(), time.monotonic())
        else:
            task = Task(part, Worker(dies_with_parent=True), None)
            task.worker.begin(prepare)
        self._busy.append(task)
        task.worker.begin(measure, part, folder, dict(versions))

    def _look(
        self, task: Task, limit: float | None, *, ready: bool
    ) -> Record | ChildDied | str | None:
        """Record of a task, or the reason why it has none; None while it runs."""
        if ready:
            return self._collect(task)
        if limit is not None and task.begun and time.monotonic() - task.begun > limit:
            self._end_worker(task)
            return f"no outcome after {limit:g} s; its process was ended"
        return None

    def _collect(self, task: Task) -> Record | ChildDied | None:
        """Result from a part's process; None where that has only become ready to begin."""
        try:
            found: Record | CellError | None = task.worker.result()
        except ChildDied as died:
            self._end_worker(task)
            return died
        if found is None:
            task.begun = time.monotonic()
            return None
        self._busy.remove(task)
        self._idle.append(task.worker)
        if isinstance(found, CellError):
            raise found
        return found

    def _end_worker(self, task: Task) -> None:
        self._busy.remove(task)
        task.worker.kill()
