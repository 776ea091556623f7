"""Runs many fits in lock-step, gathering their simulations into one call of the subject.

A task is a generator that yields requests and is sent their residuals; its result does not
depend on what runs beside it.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from typing import TypeVar

from cell.gap.subject.subject import Request, Residuals

T = TypeVar("T")
Simulate = Callable[[Sequence[Request]], Sequence[Residuals]]
Task = Generator[list[Request], Sequence[Residuals], T]


def side_by_side(tasks: Sequence[Task[T]]) -> Task[list[T]]:
    """Join tasks into one that advances them in lock-step; returns their results in order."""
    results: dict[int, T] = {}
    asked: dict[int, list[Request]] = {}
    for i, task in enumerate(tasks):
        _advance(i, task, None, asked, results)
    while asked:
        order = list(asked)
        answers = list((yield [r for i in order for r in asked[i]]))
        for i in order:
            count = len(asked.pop(i))
            mine, answers = answers[:count], answers[count:]
            _advance(i, tasks[i], mine, asked, results)
    return [results[i] for i in range(len(tasks))]


def rough(simulate: Simulate) -> Simulate:
    """Coarse variant of `simulate`, for where a few percent of a response do not matter."""
    return lambda asked: simulate([replace(request, rough=True) for request in asked])


def run_one(simulate: Simulate, task: Task[T]) -> T:
    """Run one task to its end and return its result."""
    answer: Sequence[Residuals] | None = None
    while True:
        try:
            asked = next(task) if answer is None else task.send(answer)
        except StopIteration as stop:
            result: T = stop.value
            return result
        answer = simulate(asked)


def run_all(simulate: Simulate, tasks: Sequence[Task[T]]) -> list[T]:
    """Run all tasks with one simulation call a round and return their results."""
    return run_one(simulate, side_by_side(tasks))


def _advance(
    i: int,
    task: Task[T],
    answer: Sequence[Residuals] | None,
    asked: dict[int, list[Request]],
    results: dict[int, T],
) -> None:
    try:
        asked[i] = next(task) if answer is None else task.send(answer)
    except StopIteration as stop:
        results[i] = stop.value
