"""Parts of a campaign, and how an engine measures them, here or on other machines, and
keeps the results in a journal.
"""

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel

from cell.base.campaign.journal import Cost, Journal, Record, State
from cell.base.campaign.processes import ProcessPool, workers
from cell.base.campaign.progress import Meter
from cell.base.campaign.versions import versions
from cell.record.documents import plain
from drivers.base.child import ChildDied
from drivers.base.errors import CellError, Unexpected
from drivers.base.files import writing
from drivers.base.types import Calls

# of a part that kills its process: the first may have been the machine's fault
TRIES = 2
Outcome = Mapping[str, Any] | BaseModel  # of a part, of values that JSON can hold


@dataclass(frozen=True, slots=True)
class Part:
    """Part of a campaign: a call of the importable `function`, which any process can
    make, with the name `key`.

    `key` is unique among the parts, `of` the digest of the code and files that the
    outcome depends on, `cost` the estimated time on one core [s]. Equal parts give
    equal outcomes; the function raises CellError where there is none.
    """

    key: str
    of: str
    cost: float
    function: Callable[..., Outcome]
    arguments: tuple[Any, ...] = ()


def measure(part: Part, folder: Path) -> Record:
    """Measure the campaign's `part` and store its record in the journal at `folder`; a
    record that is finished is returned as it is.

    A part that raises is `failed`, with the reason. Raises ConfigurationError where the
    journal cannot be written.
    """
    journal = Journal(folder)
    record = journal.get(part.key, part.of)
    if record is not None and record.done:
        return record

    start = time.perf_counter()
    processor_start = sum(os.times()[:4])
    outcome = None
    reason = ""
    try:
        outcome = plain(dict(part.function(*part.arguments)))
    except CellError as error:
        reason = str(error)
    except Exception as error:  # noqa: BLE001  an edge: the other parts go on
        reason = str(Unexpected(error))

    # s, with that of children that ended
    processor = sum(os.times()[:4]) - processor_start
    cost = Cost(wall=time.perf_counter() - start, processor=processor)
    state: State = "failed" if outcome is None else "measured"
    return store_record(part, folder, state, outcome=outcome, reason=reason, cost=cost)


def store_record(part: Part, folder: Path, state: State, **facts: Any) -> Record:
    """Store and return the record of `part` in the `state`, with its `facts` and the
    host and versions of this process.

    One in the `state` set_aside, with a `reason`, is of a part that gave no record
    itself.
    """
    where: dict[str, Any] = {"versions": versions(), "host": os.uname().nodename}
    record = Record(schema=1, key=part.key, of=part.of, state=state, **facts, **where)
    Journal(folder).put(record)
    return record


def compile_rod() -> None:
    """Compile the rod simulation, or load its cache, so that no part is charged for
    that time.
    """
    from drivers.strip.describe import describe
    from drivers.strip.file import paper_strip
    from drivers.strip.rod.engine import Rod

    rod = Rod(20)
    rod.reset([describe(paper_strip(0.1, 0.01))])
    rod.step(np.array([[0.6, 0.0, 0.0]]), 0.005)


class Engine(Protocol):
    """Protocol of an engine that measures parts, here or on other machines."""

    def measure(self, parts: Sequence[Part], folder: Path) -> Iterator[Record]:
        """Yield the records of `parts` as they finish, each stored in the journal at
        `folder`.
        """

    def calls(self) -> AbstractContextManager[Calls]:
        """Open a function that carries out calls on the engine, for a search that keeps
        a journal of its own.
        """


@dataclass(frozen=True, slots=True)
class Local:
    """Engine that measures in `jobs` local processes; `limit` [s] bounds the wall time
    of a part, unless None.
    """

    jobs: int = 1
    limit: float | None = None

    def measure(self, parts: Sequence[Part], folder: Path) -> Iterator[Record]:
        """Yield the records of `parts` as they finish; raises CellError if one cannot
        be stored.
        """
        pool = ProcessPool(min(self.jobs, len(parts)), compile_rod)
        try:
            yield from measure_in(pool, parts, folder, self.limit)
        finally:
            pool.kill()

    def calls(self) -> AbstractContextManager[Calls]:
        """Open a function that carries out calls in the local processes; it raises
        WorkersLost when one of them dies.
        """
        return workers(self.jobs)


def measure_in(
    pool: ProcessPool, parts: Sequence[Part], folder: Path, limit: float | None
) -> Iterator[Record]:
    """Measure `parts` in the processes of `pool`, and yield their records as they
    finish.

    A part that outlives its `limit` [s], or kills its process twice, is set aside.
    Raises CellError where a record cannot be stored.
    """
    waiting = deque((part, measure, (part, folder)) for part in parts)
    deaths = Counter[str]()
    for part, result in pool.carry_out(waiting, limit):
        if isinstance(result, CellError):
            raise result
        if isinstance(result, ChildDied):
            deaths[part.key] += 1
            if deaths[part.key] < TRIES:
                waiting.append((part, measure, (part, folder)))
            else:
                reason = f"its process died {TRIES} times: {result}"
                yield store_record(part, folder, "set_aside", reason=reason)
        elif isinstance(result, TimeoutError):
            yield store_record(part, folder, "set_aside", reason=str(result))
        else:
            yield result


def carry_out(
    parts: Sequence[Part],
    folder: Path,
    engine: Engine,
    meter: Meter,
    *,
    again: bool = False,
) -> Iterator[Record]:
    """Yield the record of each of `parts`: first those already finished, then the
    others as the `engine` finishes them.

    The journal at `folder` keeps the records; `again` measures all parts anew. Raises
    CellError where the journal cannot be written or the workers are gone,
    KeyboardInterrupt from the keyboard; finished parts are kept in either case.
    """
    journal = Journal(folder)
    by_name = {(part.key, part.of): part for part in parts}
    if again:
        journal.forget(by_name)

    stored = {name: journal.get(*name) for name in by_name}
    finished = {
        name: record for name, record in stored.items() if record and record.done
    }
    finished_cost = sum(by_name[name].cost for name in finished)
    meter.begin(
        len(parts), len(finished), sum(part.cost for part in parts), finished_cost
    )
    yield from finished.values()
    unfinished = [part for name, part in by_name.items() if name not in finished]
    if not unfinished:
        return

    make_folder(folder)
    for record in engine.measure(unfinished, folder):
        meter.finish(by_name[record.key, record.of].cost, record)
        yield record


def make_folder(folder: Path) -> None:
    """Make the folder `folder`, which workers must be able to find; raises
    ConfigurationError where that fails.
    """
    with writing(f"--out: {folder}", "name another folder"):
        folder.mkdir(parents=True, exist_ok=True)
