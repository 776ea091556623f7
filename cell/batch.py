"""Several folds: one after the other, or side by side in processes of their own."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from multiprocessing.connection import wait
from pathlib import Path

from calibration.calibration import Calibration
from cell.config.places import find_configs
from cell.config.plant import load_plant
from cell.fold import Request
from cell.opening import check_drivers
from cell.result import FoldResult
from cell.worker import Worker
from drivers.errors import CellError
from policies.registry import make_policy

GLANCE = 0.1  # s between looks at the keyboard


def requests(base: Request, plants: Sequence[Path], repeat: int) -> tuple[Request, ...]:
    """Fold number i, plants outermost, then repeats, uses seed S + i."""
    lying: Sequence[Path | None] = plants or [None]
    folds = [(plant, index) for plant in lying for index in range(repeat)]
    return tuple(
        replace(
            base,
            choice=replace(base.choice, plant=plant, index=index, seed=base.choice.seed + i),
        )
        for i, (plant, index) in enumerate(folds)
    )


def checked(wanted: Sequence[Request]) -> Sequence[Request]:
    """`wanted`, which differ in plant and seed, after a look at every file that they name.

    Raises ConfigurationError before anything has moved, not in the middle of the folds.
    """
    first = wanted[0]
    configs = find_configs(first.configs)
    check_drivers(configs.cell(), first.choice)
    configs.strip(first.strip)
    make_policy(first.policy, first.checkpoint)
    for request in wanted:
        if request.choice.plant is not None:
            load_plant(request.choice.plant)
    return wanted


def side_by_side(
    wanted: Sequence[Request],
    jobs: int,
    interrupted: Callable[[], bool] = lambda: False,
    calibration: Calibration | None = None,
) -> Iterator[FoldResult]:
    """The results in the order of the requests, `jobs` folds at a time.

    Once `interrupted`, the folds under way stop under control and no other begins; after a
    KeyboardInterrupt they stop at once. A fold that raised CellError raises it in its turn.
    """
    team = Team([Worker() for _ in range(min(jobs, len(wanted)))], wanted, calibration)
    try:
        for number in range(len(wanted)):
            result = team.result(number, interrupted)
            if result is None:
                return
            if isinstance(result, CellError):
                raise result
            yield result
    finally:
        team.close()


class Team:
    """Workers who share the folds that are wanted."""

    def __init__(
        self, workers: list[Worker], wanted: Sequence[Request], calibration: Calibration | None
    ) -> None:
        self._workers = workers
        self._calibration = calibration
        self._waiting = deque(enumerate(wanted))
        self._done: dict[int, FoldResult | CellError] = {}
        self._told = 0

    def result(self, number: int, interrupted: Callable[[], bool]) -> FoldResult | CellError | None:
        """What came of fold `number`; None when it was not begun and will not be."""
        while number not in self._done:
            try:
                if interrupted() and not self._told:
                    self._stop()
                self._begin()
                if not self._busy:
                    return None
                self._collect()
            except KeyboardInterrupt:
                if self._told > 1:
                    raise
                self._stop()
        return self._done.pop(number)

    def close(self) -> None:
        """Let everybody go."""
        for worker in self._workers:
            worker.release()
        for worker in self._workers:
            worker.join()

    @property
    def _busy(self) -> list[Worker]:
        return [worker for worker in self._workers if worker.task is not None]

    def _begin(self) -> None:
        for worker in self._workers:
            if worker.task is None and self._waiting:
                worker.begin(*self._waiting.popleft(), self._calibration)

    def _collect(self) -> None:
        """Take what is finished, waiting a moment for it."""
        ready = wait([worker.pipe for worker in self._busy], GLANCE)
        for worker in self._busy:
            if worker.pipe in ready and worker.task is not None:
                number = worker.task
                self._done[number] = worker.result()

    def _stop(self) -> None:
        self._told += 1
        self._waiting.clear()
        for worker in self._workers:
            worker.stop()
