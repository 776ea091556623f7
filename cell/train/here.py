"""Workers on this machine: processes, for a third of a piece is Python, where threads queue."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from threading import Thread

from drivers.errors import WorkersLost


def cores() -> int:
    """Cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1


@contextmanager
def workers_here(jobs: int) -> Iterator[Executor]:
    """An executor over `jobs` processes, over this very one for a single job.

    Raises WorkersLost when a process dies.
    """
    if jobs == 1:
        with ThreadPoolExecutor(1) as one:
            yield one
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_follow_leader) as pool:
        try:
            yield pool
        except BrokenProcessPool:
            raise WorkersLost("a worker process died") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _follow_leader() -> None:
    """Ctrl-C is for the process that leads, and without it there is nothing left to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_leader, daemon=True).start()


def _end_with_leader() -> None:
    leader = parent_process()
    if leader is not None:
        leader.join()
        os._exit(1)
