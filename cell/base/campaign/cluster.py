"""Engine that measures a campaign's parts on a Dask cluster; the journal holds the
results.

Known traps and what is done here: a part runs in a process of its own beside the Dask
worker, so that a part that holds the interpreter cannot look like a dead worker
(distributed#6324), and one that kills its process is known by name; a worker has one
part at a time, so that there is nothing to steal (distributed#7523); outcomes are
files, so that a worker's death repeats nothing that was finished (distributed#7870).
"""

import gc
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from cell.base.campaign.journal import Journal, Record
from cell.base.campaign.processes import ProcessPool
from cell.base.campaign.run import Part, compile_rod, measure_in, store_record
from cell.base.campaign.versions import versions
from drivers.base.errors import ConfigurationError, WorkersLost
from drivers.base.extras import require_library
from drivers.base.types import Arguments, Calls

if TYPE_CHECKING:
    from distributed import Client, Future
    from tornado.ioloop import IOLoop

CONNECT_TIMEOUT = 20.0  # s in which scheduler and first worker must answer at the start
ABSENCE = 300.0  # s that a cluster may be gone in the middle, to be started again
POLL_INTERVAL = 2.0  # s between looks at whether scheduler and workers are there
# times that Dask may give up: a part, after several deaths of workers; its event loop
TRIES = 3


@dataclass(frozen=True, slots=True)
class Cluster:
    """Engine that measures on the Dask cluster at `address` (tcp://HOST:PORT); `limit`
    [s] bounds the time of a part, unless None.
    """

    address: str
    limit: float | None = None

    def measure(self, parts: Sequence[Part], folder: Path) -> Iterator[Record]:
        """Yield the records of `parts` as they finish, despite deaths of workers and
        scheduler.

        Raises ConfigurationError for an address without a usable cluster or a worker of
        other versions, WorkersLost where the cluster stays away.
        """
        unfinished = {(part.key, part.of): part for part in parts}
        patience = CONNECT_TIMEOUT
        while unfinished:
            with _silence_dask(), connect(self.address, patience) as client:
                left = list(unfinished.values())
                for record in _run_until_lost(client, left, folder, self.limit):
                    unfinished.pop((record.key, record.of), None)
                    yield record
            patience = ABSENCE

    @contextmanager
    def calls(self) -> Iterator[Calls]:
        """Open a function that carries out calls on the cluster, where another worker
        repeats those of a dead one.

        Raises ConfigurationError for an address without a usable cluster, WorkersLost
        when the cluster is gone.
        """
        with _silence_dask(), connect(self.address, CONNECT_TIMEOUT) as client:
            from distributed import KilledWorker

            executor = client.get_executor(pure=False)

            def carry_out(
                function: Callable[..., Any], calls: Arguments
            ) -> Iterator[tuple[int, Any]]:
                waiting = {
                    executor.submit(function, *each): i for i, each in enumerate(calls)
                }
                return (
                    (waiting[done], done.result()) for done in as_completed(waiting)
                )

            try:
                yield carry_out
            except KilledWorker:
                lost = "several workers died over the same piece"
                raise WorkersLost(f"{self.address}: {lost}") from None
            except (CancelledError, ConnectionError):
                raise WorkersLost(f"{self.address}: the connection was lost") from None


@contextmanager
def connect(address: str, patience: float) -> Iterator["Client"]:
    """Connect a client to the Dask cluster at `address` (tcp://HOST:PORT), which must
    answer within `patience` [s].

    Raises ConfigurationError where it does not, or has no workers, or workers of other
    versions.
    """
    require_library("distributed")
    from distributed import Client

    with event_loop() as loop:
        client = None
        try:
            client = Client(address, timeout=patience, set_as_default=False, loop=loop)
        # TypeError: tls:// without certificates
        except (OSError, ValueError, TypeError) as error:
            reason = str(error).splitlines()[0]
        if client is None:
            # of the client that failed: at the end of the process it would wait 40 s
            gc.collect()
            raise ConfigurationError(
                f"--cluster: {address}: no scheduler answers ({reason:.80}); start one"
                " with `dask scheduler`, and workers with `dask worker ADDRESS`"
            )
        try:
            _check(client, address, patience)
            yield client
        finally:
            with suppress(TimeoutError, OSError):
                client.close(timeout=1)


@contextmanager
def event_loop() -> Iterator["IOLoop"]:
    """Run an event loop in a thread until the block ends, for a client or cluster of
    Dask.

    Dask asserts that it begins within 10 s, which no setting changes: a machine that
    stands still for longer is given another try.
    """
    from distributed.utils import LoopRunner

    for tries_left in reversed(range(TRIES)):
        runner = LoopRunner()
        try:
            runner.start()
            break
        except AssertionError:
            if not tries_left:
                raise
    try:
        yield runner.loop
    finally:
        with suppress(TimeoutError):
            runner.stop()


def _run_until_lost(
    client: "Client", parts: list[Part], folder: Path, limit: float | None
) -> Iterator[Record]:
    """Yield the records of `parts`, one part per thread of the cluster, until all are
    done or the scheduler is gone.
    """
    from distributed import wait

    waiting = parts[::-1]  # popped from the end: in the order of parts
    killed = Counter[str]()
    client_versions = versions()
    running: dict[Future[str], Part] = {}
    last_seen = time.monotonic()
    while (waiting or running) and client.status == "running":
        threads = _thread_count(client)
        while waiting and len(running) < max(threads, 1):
            part = waiting.pop()
            arguments = (part, str(folder.resolve()), client_versions, limit)
            running[client.submit(remote, *arguments, pure=False)] = part
        with suppress(TimeoutError, CancelledError), client.as_current():
            wait(list(running), timeout=POLL_INTERVAL, return_when="FIRST_COMPLETED")
        for future in [future for future in running if future.done()]:
            part = running.pop(future)
            record = _store_record(future, part, folder, killed)
            if record is None:
                waiting.append(part)
            else:
                yield record
        last_seen = time.monotonic() if threads else last_seen
        if time.monotonic() - last_seen > ABSENCE:
            raise WorkersLost(f"no worker for {ABSENCE:.0f} s")


def _thread_count(client: "Client") -> int:
    """Number of threads of all the cluster's workers; 0 where the scheduler does not
    answer.
    """
    try:
        return sum(client.nthreads().values())
    except (OSError, TimeoutError):
        return 0


def _store_record(
    future: "Future[str]", part: Part, folder: Path, killed: Counter[str]
) -> Record | None:
    """Record of a finished `part` from its `future`; None where the worker or the
    scheduler died.

    It is stored here where the worker shares no folder with us.
    """
    from distributed import KilledWorker

    try:
        record = Record.model_validate_json(future.result(timeout=POLL_INTERVAL))
    except KilledWorker:
        killed[part.key] += 1
        if killed[part.key] < TRIES:
            return None
        reason = "many workers died while they had it"
        return store_record(part, folder, "set_aside", reason=reason)
    except (CancelledError, TimeoutError, OSError):
        return None
    finally:
        future.release()
    journal = Journal(folder)
    stored = journal.get(record.key, record.of)
    if stored is None or not stored.done:
        journal.put(record)
    return record


def remote(
    part: Part, folder: str, expected: Mapping[str, str], limit: float | None
) -> str:
    """Measure the campaign's `part` on a cluster's worker, in a process of its own
    there; returns the record as JSON.

    Raises ConfigurationError where this worker has other versions than the client.
    """
    difference = _different_versions(expected, versions())
    if difference:
        raise ConfigurationError(
            f"--cluster: a worker {difference}; install the same there"
        )

    local = Path(folder) if Path(folder).is_dir() else _local_folder()
    pools = _idle_pools()
    pool = ProcessPool(1, compile_rod) if pools.empty() else pools.get()
    [record] = measure_in(pool, [part], local, limit)
    pools.put(pool)
    return record.model_dump_json(by_alias=True)


@cache
def _idle_pools() -> "SimpleQueue[ProcessPool]":
    """Pools of one idle process each, kept on this worker for its next parts."""
    return SimpleQueue()


@cache
def _local_folder() -> Path:
    """Journal folder of this worker alone, used where the client's folder is not
    reachable.
    """
    return Path(mkdtemp(prefix="campaign-"))


def _check(client: "Client", address: str, patience: float) -> None:
    """Raise ConfigurationError for a cluster without workers within `patience` [s], or
    with other library versions than here.
    """
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError:
        raise ConfigurationError(
            f"--cluster: {address}: has no workers; start some with `dask worker"
            f" {address}`"
        ) from None
    expected = versions()
    for worker, found in client.run(versions, on_error="return").items():
        if found != expected:
            difference = _different_versions(expected, found)
            raise ConfigurationError(
                f"--cluster: {worker}: {difference}; install the same there"
            )


def _different_versions(expected: Mapping[str, str], found: object) -> str:
    """Text on how versions `found` on a worker differ from `expected`; empty where they
    agree.
    """
    if not isinstance(found, Mapping):
        return f"cannot run the cell ({found})"
    other = [
        f"{n} {found.get(n)}, here {v}"
        for n, v in expected.items()
        if found.get(n) != v
    ]
    return f"has {', '.join(other)}" if other else ""


@contextmanager
def _silence_dask() -> Iterator[None]:
    """Silence Dask's log of lost workers and connections, which the command reports
    itself.
    """
    loggers = list(map(logging.getLogger, ("distributed", "distributed.client")))
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
