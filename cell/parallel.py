"""Work in local processes: independent parts, and pools of workers.

Processes, not threads: a third of the work holds the GIL.
"""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any, Protocol, TypeVar

from drivers.errors import CellError, WorkersLost

INTERRUPTED = 130  # exit code
R_co = TypeVar("R_co", covariant=True)


class Part(Protocol[R_co]):
    """A value that another process can measure; the same part gives the same result."""

    @property
    def key(self) -> str:
        """Unique name among the parts."""
        ...

    def measure(self) -> R_co:
        """Its result; raises CellError where there is none."""
        ...


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a part has no result."""

    reason: str


P = TypeVar("P", bound=Part[Any])
R = TypeVar("R")


def run(
    parts: Sequence[P], jobs: int, measure: Callable[[P], R]
) -> Iterator[tuple[P, R | Refusal]]:
    """Every part with its result by `measure`, `jobs` at a time, in the order of completion.

    One that raises CellError is a Refusal. When a process dies, the unfinished parts are measured
    one at a time, so that the part that kills its process is found and refused too.
    """
    left = list(parts)
    width = jobs
    while left:
        died = False
        for part, result in _shift(left, width, measure):
            if result is None:
                died = True
                continue
            left.remove(part)
            yield part, result
        if died and width == 1:
            yield left[0], Refusal("its process died")
            left.pop(0)
        width = 1


@contextmanager
def workers(jobs: int) -> Iterator[Executor]:
    """An executor over `jobs` processes, over a thread of this process for a single job.

    Raises WorkersLost when a process dies.
    """
    if jobs == 1:
        with ThreadPoolExecutor(1) as one:
            yield one
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_ignore_keyboard) as pool:
        try:
            yield pool
        except BrokenProcessPool:
            raise WorkersLost("a worker process died") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def cores() -> int:
    """Cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1


def _shift(
    parts: Sequence[P], jobs: int, measure: Callable[[P], R]
) -> Iterator[tuple[P, R | Refusal | None]]:
    """Results of one pool of processes; None for parts left unfinished when it broke."""
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_obey_keyboard) as pool:
        waiting: dict[Future[R | Refusal], P] = {
            pool.submit(_measured, measure, part): part for part in parts
        }
        try:
            for future in as_completed(waiting):
                try:
                    yield waiting[future], future.result()
                except BrokenProcessPool:
                    yield waiting[future], None
        except (KeyboardInterrupt, GeneratorExit):
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _measured(measure: Callable[[P], R], part: P) -> R | Refusal:
    try:
        return measure(part)
    except CellError as error:
        if error.exit_code == INTERRUPTED:
            os._exit(INTERRUPTED)
        return Refusal(str(error))
    except KeyboardInterrupt:  # the fold has stopped; another part must not begin here
        os._exit(INTERRUPTED)


def _obey_keyboard() -> None:
    """SIGINT ends a worker silently, except in a fold, which stops its arm first."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _end_with_parent(INTERRUPTED)


def _ignore_keyboard() -> None:
    """Ignore SIGINT in workers; the main process handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent(1)


def _end_with_parent(code: int) -> None:
    """End this worker with `code` once its parent process is gone."""
    Thread(target=_watch_parent, args=(code,), daemon=True).start()


def _watch_parent(code: int) -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(code)
