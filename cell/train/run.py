"""Runs a whole training in one folder: starts or resumes it, then evaluates its weights."""

import fcntl
import json
import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from cell.train.effects import EffectErrors
from cell.train.evaluation import Evaluation, evaluate, fold_row
from cell.train.screen import GenerationText, Meter
from drivers.errors import ConfigurationError
from drivers.files import write_file, writing
from policies.adaptive.train.settings import CriticSettings
from policies.adaptive.train.trial import Trial
from policies.train.settings import TrainingSettings
from policies.train.training import TrainingRun

EVALUATION = "evaluation.json"


@dataclass(frozen=True, slots=True)
class Trained:
    """Result of a training: checkpoint, settings, evaluations; of `adaptive` its trial on left-out
    folds and its errors by hidden effect.
    """

    checkpoint: Path
    settings: TrainingSettings | CriticSettings
    evaluations: tuple[Evaluation, ...]
    trial: Trial | None = None
    effects: tuple[EffectErrors, ...] = ()

    def line(self) -> dict[str, object]:
        """Content of the training's record in JSON."""
        return {
            "schema": 1,
            "checkpoint": str(self.checkpoint),
            "settings": self.settings.model_dump(mode="json"),
            **({} if self.trial is None else {"trial": self.trial.facts()}),
            "evaluations": [evaluation.line() for evaluation in self.evaluations],
            **({"effects": {e.effect: e.facts() for e in self.effects}} if self.effects else {}),
        }


def train(
    settings: TrainingSettings,
    folder: Path,
    workers: AbstractContextManager[Executor],
    side: int,
    console: Console,
) -> Trained:
    """Train `feedback` in `folder`; an interrupted training of the same settings is resumed.

    The weights are evaluated on a grid of `side` x `side` strips. Raises ConfigurationError for a
    folder that cannot be used, WorkersLost when the workers are gone.
    """
    with alone_in(folder):
        run = TrainingRun(settings, folder)
        text = GenerationText(settings.generations)
        with workers as executor, Meter(console, settings.generations, run.known) as meter:
            for step in run.run(executor):
                meter.show(step.generation + 1, text(step))
            weights = (run.weights, settings)
            found = evaluate(fold_row, weights, side, executor, meter.show_evaluation)
        return keep(Trained(run.checkpoint, settings, found), folder)


def keep(trained: Trained, folder: Path) -> Trained:
    """Write the evaluation of `trained` to `folder`; raises ConfigurationError if that fails."""
    content = json.dumps(trained.line(), indent=1) + "\n"
    write_file(folder / EVALUATION, content, "make room and run the command again")
    return trained


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Create `folder` and lock it against other trainings; raises ConfigurationError on failure."""
    with writing(f"--out: {folder}", "name another folder"):
        folder.mkdir(parents=True, exist_ok=True)
        place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigurationError(
                f"--out: {folder}: another training is writing there; wait, or name another folder"
            ) from None
        yield
    finally:
        os.close(place)
