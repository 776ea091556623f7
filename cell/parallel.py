"""Pools of local worker processes, for work that keeps its own journal.

Processes, not threads: a third of the work holds the GIL.
"""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from threading import Thread

from drivers.errors import WorkersLost


@contextmanager
def workers(jobs: int) -> Iterator[Executor]:
    """Open an executor over `jobs` processes, or over one thread of this process for a single job.

    Raises WorkersLost when a process dies.
    """
    if jobs == 1:
        with ThreadPoolExecutor(1) as one:
            yield one
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_prepare_worker) as pool:
        try:
            yield pool
        except BrokenProcessPool:
            raise WorkersLost("a worker process died") from None
        except BaseException:  # Ctrl-C too: the pool's own exit would wait for all queued work
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def cores() -> int:
    """Number of cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1


def _prepare_worker() -> None:
    """Make this worker ignore SIGINT, which the main process handles, and end with its parent."""
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
