"""Batches of folds: in sequence, in parallel processes, or until one has its edges
aligned.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, replace

from calibration.calibration import Calibration
from cell.base.campaign.processes import ProcessPool, StopSignal
from cell.folding.fold import fold
from cell.folding.request import Request, with_correction
from cell.folding.result import FoldResult
from cell.orchestrator.operator import Interrupt, Interrupted
from cell.orchestrator.run import Observer
from cell.setup.arm.run_settings import consent
from cell.setup.calibration_in_use import calibration_of
from cell.setup.doctor.check import Check
from cell.setup.doctor.doctor import BRIEF, hardware_checks
from cell.setup.doctor.machine import versions
from drivers.base.child import ChildDied
from drivers.base.errors import CellError, Fault, PreflightRefused, Unexpected

POLL_INTERVAL = 0.1  # s between looks at the keyboard
ObserverContext = AbstractContextManager[tuple[Observer, ...]]


def _nobody_lays() -> None:
    """Raise PreflightRefused, because no person is there to lay the strip again before
    the next fold.
    """
    raise PreflightRefused(
        "nobody lays the strip again for the next fold of a real robot"
    )


@dataclass(frozen=True, slots=True)
class Callbacks:
    """Functions by which a batch of folds talks to the person at the cell; the default
    ones assume that nobody is there.

    `interrupt` makes a context that asks for a controlled stop, `report` takes a
    remark, `lay_again` waits until the strip lies for the next fold of a real robot,
    `observe` makes a context of the observers of a strip's fold, and `tell` takes the
    result of each recorded fold as soon as it is known. `begin` takes the
    request of each fold that begins, and `end` that of each recorded one with its
    result, in the order in which they end.
    """

    interrupt: Callable[[], AbstractContextManager[Callable[[], bool]]] = Interrupt
    report: Callable[[str], None] = lambda _: None
    lay_again: Callable[[], None] = _nobody_lays
    observe: Callable[[str], ObserverContext] = lambda _: nullcontext(())
    tell: Callable[[FoldResult], None] = lambda _: None
    begin: Callable[[Request], None] = lambda _: None
    end: Callable[[Request, FoldResult], None] = lambda _, __: None


def fold_all(
    requests: Sequence[Request],
    jobs: int = 1,
    until: float | None = None,
    callbacks: Callbacks = Callbacks(),
) -> Iterator[FoldResult]:
    """Carry out the folds of `requests`, up to `jobs` at a time, and yield the result
    of each in the order of the requests.

    One that cannot begin has a result without a `run`, and the others follow. With
    `until` each is corrected by those before it, and the first one whose edges lie as
    close [m] is the last, as is one that was stopped. A real robot folds in sequence.
    The first Ctrl-C brakes the running folds and starts no other; raises Interrupted
    where no fold ended by it, and Interrupted or KeyboardInterrupt on the second.
    """
    if until is not None:
        results = _fold_in_sequence(
            (with_correction(request, "on") for request in requests), callbacks
        )
    elif jobs > 1 and len(requests) > 1 and not requests[0].trial.agreed:
        results = _fold_in_parallel(requests, jobs, callbacks)
    else:
        results = _fold_in_sequence(requests, callbacks)
    codes = [0]
    with closing(results):
        for result in results:
            yield result
            if until is not None and result.ends(until):
                return
            codes.append(result.exit_code)
    if len(codes) <= len(requests) and max(codes) < Interrupted.exit_code:
        raise Interrupted("interrupted before all folds had begun")


def _fold_in_parallel(
    requests: Sequence[Request], jobs: int, callbacks: Callbacks
) -> Generator[FoldResult, None, None]:
    """Carry out the folds of `requests` in `jobs` processes side by side, and yield
    their results in the order of the requests.
    """
    folds = ParallelFolds(requests, jobs, callbacks)
    with callbacks.interrupt() as interrupted, closing(folds):
        for result in folds.results(interrupted):
            if result.run:
                callbacks.tell(result)
            yield result


def agreed(
    requests: Sequence[Request], ask: Callable[[str], str]
) -> tuple[Request, ...]:
    """Copies of `requests` that hold the operator's consent to the motion of a real
    robot; where no real robot moves, they need none.

    Raises PreflightRefused where the consent is not typed, or a check of the hardware
    fails.
    """
    cell = requests[0].cell
    checks: list[Check] = []
    if cell.is_physical:
        checks = [versions(), *hardware_checks(cell, requests[0].runs, BRIEF)]
    consented = consent(cell, ask, checks)
    return tuple(
        replace(request, trial=replace(request.trial, agreed=consented))
        for request in requests
    )


def _fold_in_sequence(
    requests: Iterator[Request] | Sequence[Request], callbacks: Callbacks
) -> Generator[FoldResult, None, None]:
    """Carry out the folds of `requests` one after the other, where a person lays the
    strip again before each further fold of a real robot.
    """
    for number, request in enumerate(requests):
        if request.trial.agreed and number > 0:
            callbacks.lay_again()
        with callbacks.interrupt() as interrupted:
            try:
                with callbacks.observe(request.strip.name) as observers:
                    calibration = calibration_of(
                        request.cell, callbacks.report, interrupted
                    )
                    callbacks.begin(request)
                    result = fold(request, calibration, observers, interrupted)
                callbacks.tell(result)
            except CellError as error:
                result = FoldResult.refusal(request, error)
            if result.run:
                callbacks.end(request, result)
        yield result
        if interrupted():
            return


class ParallelFolds:
    """Folds that a pool of processes carries out side by side, whose results come in
    the order of their requests.
    """

    def __init__(
        self, requests: Sequence[Request], jobs: int, callbacks: Callbacks
    ) -> None:
        self._callbacks = callbacks
        self._requests = requests
        self._waiting = deque(enumerate(requests))
        self._pool = ProcessPool(jobs, dies_with_parent=False)
        self._done: dict[int, FoldResult | CellError] = {}
        self._stops = 0

    def results(self, interrupted: Callable[[], bool]) -> Iterator[FoldResult]:
        """Yield the results of the folds in the order of their requests, up to the last
        fold that was started.

        Once `interrupted`, the folds under way stop under control and no other begins;
        after a KeyboardInterrupt they stop at once, and a second one is raised.
        """
        done = self._done
        for number in range(len(self._requests)):
            while number not in done:
                try:
                    if interrupted() and not self._stops:
                        self._stop()
                    self._begin(interrupted)
                    if not self._pool.is_busy and number not in done:
                        return
                    self._collect()
                except KeyboardInterrupt:
                    if self._stops > 1:
                        raise
                    self._stop()
            end = done.pop(number)
            request = self._requests[number]
            yield (
                FoldResult.refusal(request, end) if isinstance(end, CellError) else end
            )

    def close(self) -> None:
        """End all processes of the pool; a fold that is still running is first stopped
        under control.
        """
        self._pool.close()

    def _begin(self, interrupted: Callable[[], bool]) -> None:
        """Start waiting folds while the pool has room for them; one for which no
        calibration is found ends with an error.

        A fold leaves the queue after its calibration, so that Ctrl-C meanwhile does not
        lose it.
        """
        waiting = self._waiting
        while waiting and self._pool.has_room:
            number, request = waiting[0]
            try:
                calibration = calibration_of(
                    request.cell, self._callbacks.report, interrupted
                )
                self._callbacks.begin(request)
            except CellError as error:
                waiting.popleft()
                self._done[number] = error
                continue
            waiting.popleft()
            self._pool.begin(
                number, _fold_in_process, request, calibration, stoppable=True
            )

    def _collect(self) -> None:
        """Store the results of the folds that have ended, after a short wait for one to
        end.
        """
        for number, result in self._pool.ended(POLL_INTERVAL):
            if isinstance(result, ChildDied):
                result = Fault("process_died", f"the process of a fold: {result}")  # noqa: PLW2901
            self._done[number] = result
            if isinstance(result, FoldResult) and result.run:
                self._callbacks.end(self._requests[number], result)

    def _stop(self) -> None:
        """Start no further fold, and ask the folds that are running to stop under
        control.
        """
        self._stops += 1
        self._waiting.clear()
        self._pool.stop()


def _fold_in_process(
    request: Request, calibration: Calibration, stop: StopSignal
) -> FoldResult | CellError:
    """Result of one fold, carried out in a process of the pool; an error is returned in
    its place, not raised.
    """
    try:
        return fold(request, calibration, (), stop)
    except KeyboardInterrupt:
        return Interrupted("stopped at once by Ctrl-C or a signal")
    except CellError as error:
        return error
    except Exception as error:  # noqa: BLE001  an edge: the other folds go on, this one fails
        return Unexpected(error)
