"""Several folds: one after the other, or side by side in processes of their own."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

from cell.fold import Request, fold
from cell.interrupt import Interrupt
from cell.result import FoldResult


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


def side_by_side(wanted: Sequence[Request], jobs: int) -> Iterator[FoldResult]:
    """The results in the order of the requests, `jobs` folds at a time."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_fold_alone, wanted)


def _fold_alone(request: Request) -> FoldResult:
    with Interrupt() as interrupted:
        return fold(request, interrupted=interrupted)
