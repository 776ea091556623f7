"""Training of the critic of `adaptive`: started or resumed, evaluated on both engines."""

import json
from concurrent.futures import Executor, as_completed
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from threadpoolctl import threadpool_limits

from cell.train.evaluation import Engine, Evaluation, make_stepper
from cell.train.run import EVALUATION, alone_in
from drivers.files import write_file
from drivers.strip.describe import describe
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.critic import Critic
from policies.adaptive.train.settings import CriticSettings
from policies.adaptive.train.training import CriticTraining
from policies.adaptive.train.trial import Trial
from policies.domain import grid
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGES


@dataclass(frozen=True, slots=True)
class TrainedCritic:
    """Result of a training: path, settings and evaluation of the weights."""

    checkpoint: Path
    settings: CriticSettings
    trial: Trial
    evaluations: tuple[Evaluation, ...]

    def line(self) -> dict[str, object]:
        """One JSON object."""
        return {
            "schema": 1,
            "checkpoint": str(self.checkpoint),
            "settings": self.settings.model_dump(mode="json"),
            "trial": self.trial.facts(),
            "evaluations": [evaluation.line() for evaluation in self.evaluations],
        }


def train_critic(
    settings: CriticSettings,
    folder: Path,
    workers: AbstractContextManager[Executor],
    side: int,
    console: Console,
) -> TrainedCritic:
    """Train in `folder`, where an interrupted training of the same settings is resumed.

    The weights are evaluated on a grid of `side` x `side` strips. Raises ConfigurationError for a
    folder that cannot be used, WorkersLost when the workers are gone.
    """
    with alone_in(folder), workers as executor:
        training = CriticTraining(settings, folder)
        try:
            with _bar(console) as bar:
                task = bar.add_task("begins", total=training.total)
                for step in training.run(executor):
                    bar.update(task, completed=step.done, description=step.said)
                    if not console.is_terminal:
                        text = f"{step.done} of {step.total}: {step.said}"
                        console.print(text, highlight=False, soft_wrap=True)
                bar.update(task, description="judged on both engines")
                found = evaluate_critic(training.finished, settings, side, executor)
        except KeyboardInterrupt:
            console.print("interrupted; the same command goes on", highlight=False)
            raise
        trained = TrainedCritic(training.checkpoint, settings, training.tried, found)
        content = json.dumps(trained.line(), indent=1) + "\n"
        write_file(folder / EVALUATION, content, "make room and run the command again")
        return trained


def evaluate_critic(
    critic: Critic, settings: CriticSettings, side: int, executor: Executor
) -> tuple[Evaluation, ...]:
    """Fold the `side` x `side` grid of the paper's range on each engine, a row a piece."""
    wanted = [(engine, row) for engine in reversed(Engine) for row in range(side)]
    waiting = {executor.submit(fold_row, critic, settings, side, *w): w for w in wanted}
    rows = {waiting[done]: done.result() for done in as_completed(waiting)}
    found = {engine: np.array([rows[engine, row] for row in range(side)]) for engine in Engine}
    half = 0.5 * grid(side)[0].length
    return tuple(
        Evaluation(engine, displacement=d, miss=np.where(np.isnan(d), half, np.abs(d)))
        for engine, d in found.items()
    )


def fold_row(
    critic: Critic, settings: CriticSettings, side: int, engine: Engine, row: int
) -> Array:
    """Displacements (side,) [m] of one row of the grid: a pure function."""
    strips = grid(side)[row * side : (row + 1) * side]
    rollout = Rollout(speed=settings.speed, sensing=IMAGES, substeps=4)
    rng = np.random.default_rng([settings.seed, row])
    models = [describe(strip) for strip in strips]
    with threadpool_limits(1, user_api="blas"):
        folds = roll_out(
            Adaptive(critic), make_stepper(engine), strips[0], models, settings=rollout, rng=rng
        )
    return folds.displacement


def _bar(console: Console) -> Bar:
    return Bar(
        BarColumn(bar_width=28),
        TextColumn("{task.completed} of {task.total}  {task.description}"),
        console=console,
        disable=not console.is_terminal,
    )
