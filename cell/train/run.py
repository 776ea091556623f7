"""Runs a training in one folder: starts or resumes it, then evaluates its weights."""

import fcntl
import json
import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from cell.train.evaluation import EffectErrors, Evaluation, evaluate, evaluate_effects
from drivers.errors import ConfigurationError
from drivers.files import write_file, writing
from policies.adaptive.train.shard import CriticSettings
from policies.rollout import Rollout
from policies.sensing import IMAGE_SENSING
from policies.train.objective import TrainingSettings

if TYPE_CHECKING:
    from policies.adaptive.train.training import CriticTraining, Trial
    from policies.train.search import Search

EVALUATION = "evaluation.json"
LINES = 20  # printed of a training, and of its evaluation, where there is no terminal
SUBSTEPS = 4  # between decisions of the evaluation: 4.2 ms, which the chain takes in one part


@dataclass(frozen=True, slots=True)
class Trained:
    """Result of a training: checkpoint, settings, evaluations; of `adaptive` its trial on left-out
    folds and its errors by hidden effect.
    """

    checkpoint: Path
    settings: TrainingSettings | CriticSettings
    evaluations: tuple[Evaluation, ...]
    trial: "Trial | None" = None
    effects: tuple[EffectErrors, ...] = ()

    def line(self) -> dict[str, object]:
        """Content of the training's record in JSON."""
        return {
            "schema": 1,
            "checkpoint": str(self.checkpoint),
            "settings": self.settings.model_dump(mode="json"),
            **({} if self.trial is None else {"trial": asdict(self.trial)}),
            "evaluations": [evaluation.line() for evaluation in self.evaluations],
            **({"effects": {e.effect: e.facts() for e in self.effects}} if self.effects else {}),
        }


class Meter:
    """Progress bar of a training of `total` steps, `known` done before; lines off a terminal."""

    def __init__(self, console: Console, total: int, known: int) -> None:
        self._console, self._total = console, total
        self._bar = Bar(
            BarColumn(bar_width=28),
            TextColumn("{task.description}"),
            TimeRemainingColumn(compact=True),
            console=console,
            disable=not console.is_terminal,
        )
        self._task: TaskID = self._bar.add_task("begins", total=total, completed=known)
        if known:
            console.print(f"resumed after {known} of {total}", highlight=False)

    def __enter__(self) -> Self:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Remove the bar; after Ctrl-C, print how to resume."""
        self._bar.stop()
        if kind is KeyboardInterrupt:
            self._console.print("interrupted; run the command again to resume", highlight=False)

    def show(self, done: int, text: str) -> None:
        """Show the number of steps `done`, and `text` on the last one."""
        self._advance(done, self._total, text)

    def show_evaluation(self, done: int, pieces: int) -> None:
        """Show that `done` of `pieces` of the final evaluation are done."""
        text = f"folds strips that training never folded: {done} of {pieces} pieces"
        self._advance(done, pieces, text)

    def _advance(self, done: int, total: int, text: str) -> None:
        self._bar.update(self._task, total=total, completed=done, description=text)
        due = done % max(1, total // LINES) == 0 or done == total
        if due and not self._console.is_terminal:
            self._console.print(text, highlight=False, soft_wrap=True)


def train(
    settings: TrainingSettings | CriticSettings,
    folder: Path,
    workers: AbstractContextManager[Executor],
    side: int,
    console: Console,
) -> Trained:
    """Train the policy of these `settings` in `folder`; an interrupted training is resumed.

    The weights are evaluated on a grid of `side` x `side` strips, those of `adaptive` also with
    each effect hidden. Raises ConfigurationError for a folder that cannot be used or holds a
    training of other settings, WorkersLost when the workers are gone.
    """
    with alone_in(folder):
        training = _open_training(settings, folder)
        with workers as executor, Meter(console, training.total, training.known) as meter:
            for step in training.run(executor):
                meter.show(step.done, step.text)
            policy, watch = training.policy, meter.show_evaluation
            errors: tuple[EffectErrors, ...] = ()
            if isinstance(settings, TrainingSettings):
                rollout, seed = settings.rollout, [settings.seed, 3]
            else:
                rollout = Rollout(speed=settings.speed, sensing=IMAGE_SENSING)
                seed = [settings.seed]
                errors = evaluate_effects(policy, rollout, settings.segments, executor, watch)
            finer = replace(rollout, substeps=SUBSTEPS)
            found = evaluate(policy, finer, seed, side, executor, watch)
        return keep(Trained(training.checkpoint, settings, found, training.trial, errors), folder)


def _open_training(
    settings: TrainingSettings | CriticSettings, folder: Path
) -> "Search | CriticTraining":
    if isinstance(settings, TrainingSettings):
        from policies.train.search import Search

        return Search(settings, folder)
    from policies.adaptive.train.training import CriticTraining

    return CriticTraining(settings, folder)


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
