"""Parts carried out side by side in processes of their own, whatever happens to one of them."""

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from threading import Thread

from cell.benchmark.parts.part import Part
from cell.benchmark.results import Refused, Result
from drivers.errors import CellError

INTERRUPTED = 130  # exit code


def carry_out(parts: Sequence[Part], jobs: int) -> Iterator[tuple[Part, Result]]:
    """Every part with its result, in the order in which they finish, `jobs` at a time.

    One that raises CellError is `Refused`. When a process dies, what was not finished is carried
    out one part at a time, so that the part that kills its process is known and refused too.
    """
    left = list(parts)
    width = jobs
    while left:
        died = False
        for part, result in _shift(left, width):
            if result is None:
                died = True
                continue
            left.remove(part)
            yield part, result
        if died and width == 1:
            yield left[0], Refused(part=left[0].key, reason="its process died")
            left.pop(0)
        width = 1


def _shift(parts: Sequence[Part], jobs: int) -> Iterator[tuple[Part, Result | None]]:
    """Results of one pool of processes; None for what it left undone when it broke."""
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_listen) as pool:
        waiting: dict[Future[Result], Part] = {pool.submit(_measure, part): part for part in parts}
        try:
            for future in as_completed(waiting):
                try:
                    yield waiting[future], future.result()
                except BrokenProcessPool:
                    yield waiting[future], None
        except (KeyboardInterrupt, GeneratorExit):
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _listen() -> None:
    """A worker ends silently on Ctrl-C, except in a fold, which stops its arm first.

    It ends with its parent too, however that one died.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    Thread(target=_end_with, args=(parent_process(),), daemon=True).start()


def _end_with(parent: BaseProcess | None) -> None:
    if parent is not None:
        parent.join()
        os._exit(INTERRUPTED)


def _measure(part: Part) -> Result:
    try:
        return part.measure()
    except CellError as error:
        if error.exit_code == INTERRUPTED:
            os._exit(INTERRUPTED)
        return Refused(part=part.key, reason=str(error))
    except KeyboardInterrupt:  # the fold has stopped; another part must not begin here
        os._exit(INTERRUPTED)
