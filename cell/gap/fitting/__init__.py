"""Fits of a model to measured runs, as tasks that run in lock-step: the simulations
that they request are made together.

A task is a generator that yields requests and is sent their residuals; its result does
not depend on what runs beside it.
"""

from collections.abc import Callable, Generator, Sequence
from typing import TypeVar

from cell.gap.subject.subject import Residuals, SimulationRequest

T = TypeVar("T")
Simulate = Callable[[Sequence[SimulationRequest]], Sequence[Residuals]]
Task = Generator[list[SimulationRequest], Sequence[Residuals], T]
Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of the whole that is done."""


def quiet(stage: str, fraction: float) -> None:
    """Progress callback that shows nothing."""


def side_by_side(tasks: Sequence[Task[T]]) -> Task[list[T]]:
    """Run tasks, generators of simulation requests, in lock-step with joint requests;
    returns all their results.
    """
    results: dict[int, T] = {}
    waiting: dict[int, list[SimulationRequest]] = {}

    def advance(i: int, answer: Sequence[Residuals] | None = None) -> None:
        try:
            waiting[i] = next(tasks[i]) if answer is None else tasks[i].send(answer)
        except StopIteration as stop:
            results[i] = stop.value

    for i in range(len(tasks)):
        advance(i)
    while waiting:
        order = list(waiting)
        answers = list((yield [r for i in order for r in waiting[i]]))
        for i in order:
            count = len(waiting.pop(i))
            advance(i, answers[:count])
            answers = answers[count:]
    return [results[i] for i in range(len(tasks))]


def run_one(simulate: Simulate, task: Task[T]) -> T:
    """Run one task, a generator of simulation requests, to its end with `simulate`;
    returns its result.
    """
    return run_all(simulate, [task])[0]


def run_all(simulate: Simulate, tasks: Sequence[Task[T]]) -> list[T]:
    """Run tasks in lock-step, with one call of `simulate` for the requests of each
    round; returns their results.
    """
    joint = side_by_side(tasks)
    answers: Sequence[Residuals] | None = None
    while True:
        try:
            requests = next(joint) if answers is None else joint.send(answers)
        except StopIteration as stop:
            results: list[T] = stop.value
            return results
        answers = simulate(requests)


class CountedSimulation:
    """Callable that simulates requests, and counts in `total` how many it has
    simulated.
    """

    def __init__(self, simulate: Simulate) -> None:
        self._simulate = simulate
        self.total = 0

    def __call__(self, requests: Sequence[SimulationRequest]) -> Sequence[Residuals]:
        """Simulate `requests`, add their number to `total`, and return their residuals
        in order.
        """
        self.total += len(requests)
        return self._simulate(requests)
