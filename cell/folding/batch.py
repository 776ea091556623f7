"""Several folds: in sequence, or in parallel worker processes."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from multiprocessing.connection import wait
from pathlib import Path

from calibration.calibration import Calibration
from cell.campaign import worker as process
from cell.devices.open import check_calibrated, check_drivers
from cell.folding.fold import Request, fold
from cell.folding.result import FoldResult
from cell.orchestrator.interrupt import Interrupted
from drivers.child import ChildDied
from drivers.errors import CellError, Fault, Unexpected
from drivers.strip.describe import load_plant
from drivers.strip.validity import doubts
from policies.registry import make_policy

POLL_INTERVAL = 0.1  # s between looks at the keyboard


class Worker(process.Worker):
    """Worker process that folds one request at a time.

    The first `stop` requests a controlled stop of the fold under way, as does the death of the
    parent process; a second one stops it at once.
    """

    def __init__(self) -> None:
        """Start the process without a task."""
        super().__init__()
        self.task: int | None = None

    def begin_fold(self, number: int, request: Request, calibration: Calibration | None) -> None:
        """Start to fold `request`, as task `number`."""
        self.task = number
        self.begin(_fold_one, request, calibration)

    def fold_result(self) -> FoldResult | CellError:
        """Wait for the result of the task and return it, a Fault where the process died."""
        try:
            made: FoldResult | CellError = self.result()
        except ChildDied as died:
            made = Fault("process_died", f"the process of a fold ended by itself, code {died.code}")
        self.task = None
        return made

    def stop(self) -> None:
        """Request a stop of the fold under way."""
        if self.task is not None:
            super().stop()


def _fold_one(
    request: Request, calibration: Calibration | None, stop: process.StopSignal
) -> FoldResult | CellError:
    try:
        return fold(request, interrupted=stop, calibration=calibration)
    except CellError as error:
        return error
    except KeyboardInterrupt:
        return Interrupted("stopped at once from the keyboard")
    except Exception as error:  # noqa: BLE001  an edge: the other folds go on, this one fails
        return Unexpected(error)


def requests(base: Request, plants: Sequence[Path], repeat: int) -> tuple[Request, ...]:
    """Requests of a batch: fold number i, plants outermost, then repeats, uses seed S + i."""
    lying: Sequence[Path | None] = plants or [None]
    folds = [(plant, index) for plant in lying for index in range(repeat)]
    return tuple(
        replace(
            base, choice=replace(base.choice, plant=plant, index=index, seed=base.choice.seed + i)
        )
        for i, (plant, index) in enumerate(folds)
    )


def check_requests(wanted: Sequence[Request]) -> Sequence[Request]:
    """Check the requests of a batch and return them with the files read once for all.

    They differ in plant and seed. Every file that they name is read: raises ConfigurationError
    before anything has moved, not in the middle of the folds.
    """
    first = wanted[0]
    files = first.read_files()
    check_drivers(files[0], first.choice)
    check_calibrated(files[0], first.choice)
    make_policy(first.policy, first.checkpoint)
    for request in wanted:
        if request.choice.plant is not None:
            load_plant(request.choice.plant)
    return [replace(request, files=files) for request in wanted]


def doubts_about(wanted: Sequence[Request]) -> tuple[str, ...]:
    """Warnings about strips and plants outside the range in which an engine was validated."""
    _, named = wanted[0].read_files()
    plants = [load_plant(r.choice.plant) for r in wanted if r.choice.plant is not None]
    return tuple(dict.fromkeys(doubt for strip in (named, *plants) for doubt in doubts(strip)))


def side_by_side(
    wanted: Sequence[Request], jobs: int, interrupted: Callable[[], bool] = lambda: False
) -> Iterator[FoldResult]:
    """Fold the requests, `jobs` at a time, and yield their results in order.

    Like `each_of`, but raises the CellError of the first fold that failed, and ends the others.
    """
    for result in each_of(wanted, jobs, interrupted, None):
        if isinstance(result, CellError):
            raise result
        yield result


def each_of(
    wanted: Sequence[Request],
    jobs: int,
    interrupted: Callable[[], bool],
    calibration: Calibration | None,
) -> Iterator[FoldResult | CellError]:
    """Fold the requests, `jobs` at a time, and yield their results or errors in order.

    Once `interrupted`, the folds under way stop under control and no other begins; after a
    KeyboardInterrupt they stop at once.
    """
    pool = WorkerPool([Worker() for _ in range(min(jobs, len(wanted)))], wanted, calibration)
    try:
        for number in range(len(wanted)):
            result = pool.result(number, interrupted)
            if result is None:
                return
            yield result
    finally:
        pool.close()


class WorkerPool:
    """Pool of worker processes that share a list of folds."""

    def __init__(
        self, workers: list[Worker], wanted: Sequence[Request], calibration: Calibration | None
    ) -> None:
        self._workers = workers
        self._calibration = calibration
        self._waiting = deque(enumerate(wanted))
        self._done: dict[int, FoldResult | CellError] = {}
        self._stops = 0

    def result(self, number: int, interrupted: Callable[[], bool]) -> FoldResult | CellError | None:
        """Wait for the result of fold `number`; None where it will not be started."""
        while number not in self._done:
            try:
                if interrupted() and not self._stops:
                    self._stop()
                self._begin()
                if not self._busy_workers:
                    return None
                self._collect()
            except KeyboardInterrupt:
                if self._stops > 1:
                    raise
                self._stop()
        return self._done.pop(number)

    def close(self) -> None:
        """Release all workers and wait for them."""
        for worker in self._workers:
            worker.release()
        for worker in self._workers:
            worker.join()

    @property
    def _busy_workers(self) -> list[Worker]:
        return [worker for worker in self._workers if worker.task is not None]

    def _begin(self) -> None:
        for worker in self._workers:
            if worker.task is None and self._waiting:
                worker.begin_fold(*self._waiting.popleft(), self._calibration)

    def _collect(self) -> None:
        """Collect finished results, waiting briefly for them."""
        ready = wait([worker.pipe for worker in self._busy_workers], POLL_INTERVAL)
        for worker in self._busy_workers:
            if worker.pipe in ready and worker.task is not None:
                number = worker.task
                self._done[number] = worker.fold_result()

    def _stop(self) -> None:
        self._stops += 1
        self._waiting.clear()
        for worker in self._workers:
            worker.stop()
