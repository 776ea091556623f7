"""Training of a policy in one folder: started or resumed, then evaluated."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from cell.base.campaign.progress import Meter
from cell.base.campaign.run import Engine, make_folder
from cell.studies.evaluation import EffectErrors, Evaluation, evaluate, evaluate_effects
from drivers.base.files import lock_folders, write_file
from drivers.base.types import Calls
from policies.adaptive.train.shard import CriticSettings
from policies.rollout import Rollout
from policies.sensing import IMAGE_SENSING
from policies.train.objective import TrainingSettings

if TYPE_CHECKING:
    from policies.adaptive.train.training import CriticTraining, TrialResult
    from policies.train.search import Search

EVALUATION = "evaluation.json"
# between decisions of the evaluation: 4.2 ms, which the chain takes in one part
SUBSTEPS = 4


@dataclass(frozen=True, slots=True)
class Trained:
    """Result of a training: checkpoint, settings, evaluations, errors by hidden effect,
    trial.
    """

    checkpoint: Path
    settings: TrainingSettings | CriticSettings
    evaluations: tuple[Evaluation, ...]
    trial: "TrialResult | None" = None
    effects: tuple[EffectErrors, ...] = ()

    def record(self) -> dict[str, object]:
        """Record of the training, by the keys of its JSON file."""
        content: dict[str, object] = {
            "schema": 1,
            "checkpoint": str(self.checkpoint),
            "settings": self.settings.model_dump(mode="json"),
            "evaluations": [evaluation.line() for evaluation in self.evaluations],
        }
        if self.trial is not None:
            content["trial"] = asdict(self.trial)
        if self.effects:
            content["effects"] = {e.effect: e.facts() for e in self.effects}
        return content


def train(
    settings: TrainingSettings | CriticSettings,
    folder: Path,
    engine: Engine,
    side: int,
    console: Console,
) -> Trained:
    """Train the policy of these `settings` in `folder`; an interrupted training is
    resumed.

    The weights are evaluated on a grid of `side` x `side` strips, those of `adaptive`
    also with each effect hidden. Raises ConfigurationError for a folder that cannot be
    used or holds a training of other settings, WorkersLost when the workers are gone.
    """
    make_folder(folder)
    with lock_folders([folder]):
        training = _open_training(settings, folder)
        with engine.calls() as calls:
            with Meter(console) as meter:
                meter.begin(training.total, training.known)
                for done, text in enumerate(training.run(calls), training.known + 1):
                    meter.step(done, text)
            trained = _evaluate(training, settings, side, calls, console)
        content = json.dumps(trained.record(), indent=1) + "\n"
        write_file(folder / EVALUATION, content, "make room and run the command again")
        return trained


def _evaluate(
    training: "Search | CriticTraining",
    settings: TrainingSettings | CriticSettings,
    side: int,
    calls: Calls,
    console: Console,
) -> Trained:
    """Evaluate the weights of `training` on other strips: a `side` x `side` grid, and
    by effect.
    """
    policy = training.policy
    effects = tuple[EffectErrors, ...]()
    if isinstance(settings, TrainingSettings):
        rollout = settings.rollout
        seed = [settings.seed, 3]
    else:
        rollout = Rollout(speed=settings.speed, sensing=IMAGE_SENSING)
        seed = [settings.seed]
        with Meter(console) as meter:
            effects = evaluate_effects(policy, rollout, settings.segments, calls, meter)
    finer = replace(rollout, substeps=SUBSTEPS)
    with Meter(console) as meter:
        found = evaluate(policy, finer, seed, side, calls, meter)
    trial = training.trial
    return Trained(training.checkpoint, settings, found, trial=trial, effects=effects)


def _open_training(
    settings: TrainingSettings | CriticSettings, folder: Path
) -> "Search | CriticTraining":
    """Open the training of these `settings` in `folder`, new or to be resumed."""
    if isinstance(settings, TrainingSettings):
        from policies.train.search import Search

        return Search(settings, folder)
    from policies.adaptive.train.training import CriticTraining

    return CriticTraining(settings, folder)
