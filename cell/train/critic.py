"""Trains the critic of the policy `adaptive`, and evaluates it on both engines."""

from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from cell.train.effects import evaluate_effects
from cell.train.evaluation import Engine, evaluate, make_stepper
from cell.train.run import Trained, alone_in, keep
from cell.train.screen import Meter
from drivers.strip.describe import describe
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.critic import Critic
from policies.adaptive.train.settings import CriticSettings
from policies.adaptive.train.training import CriticTraining
from policies.domain import grid
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGE_SENSING


def train_critic(
    settings: CriticSettings,
    folder: Path,
    workers: AbstractContextManager[Executor],
    side: int,
    console: Console,
) -> Trained:
    """Train the critic in `folder`; an interrupted training of the same settings is resumed.

    The weights are evaluated on a grid of `side` x `side` strips, and with each effect hidden.
    Raises ConfigurationError for a folder that cannot be used, WorkersLost when the workers are
    gone.
    """
    with alone_in(folder):
        training = CriticTraining(settings, folder)
        with workers as executor, Meter(console, training.total, 0) as meter:
            for step in training.run(executor):
                meter.show(step.done, f"{step.done} of {step.total}: {step.said}")
            critic = (training.finished, settings)
            found = evaluate(fold_row, critic, side, executor, meter.show_evaluation)
            errors = evaluate_effects(*critic, executor, meter.show_evaluation)
        return keep(Trained(training.checkpoint, settings, found, training.tried, errors), folder)


def fold_row(
    critic: Critic, settings: CriticSettings, side: int, engine: Engine, row: int
) -> Array:
    """Fold one row of the grid by `adaptive` with `critic`; returns displacements (side,) [m]."""
    strips = grid(side)[row * side : (row + 1) * side]
    rollout = Rollout(speed=settings.speed, sensing=IMAGE_SENSING, substeps=4)
    rng = np.random.default_rng([settings.seed, row])
    models = [describe(strip) for strip in strips]
    with threadpool_limits(1, user_api="blas"):
        folds = roll_out(
            Adaptive(critic), make_stepper(engine), strips[0], models, settings=rollout, rng=rng
        )
    return folds.displacement
