"""Training of a policy in one folder: started or resumed, then evaluated.

That of `adaptive` ends with a correction of its critic by folds through images.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from cell.base.campaign.journal import digest
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import Engine, Part, carry_out, make_folder
from cell.base.campaign.versions import code
from cell.base.config.places import find_configs
from cell.base.config.unmeasured_strip import unmeasured_name
from cell.base.devices.devices import Trial
from cell.folding.fold import fold
from cell.folding.request import RecordingOptions, Request
from cell.record.run import read_run
from cell.setup.calibration_in_use import calibration_of
from cell.studies.evaluation import EffectErrors, Evaluation, evaluate, evaluate_effects
from drivers.base.errors import ConfigurationError
from drivers.base.files import lock_folders, write_file
from drivers.base.types import Calls
from policies.adaptive.checkpoint import THROUGH_IMAGES, about, load_critic, save_critic
from policies.adaptive.train.shard import CriticSettings
from policies.adaptive.train.transfer import FoldedBatch, fit_transfer
from policies.rollout import Rollout
from policies.sensing import IMAGE_SENSING
from policies.strip_sampling import random_strip
from policies.train.objective import TrainingSettings

if TYPE_CHECKING:
    from policies.adaptive.train.training import CriticTraining, TrialResult
    from policies.train.search import FeedbackTraining

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
            content["effects"] = {
                effect.effect: effect.facts() for effect in self.effects
            }
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
    training: "FeedbackTraining | CriticTraining",
    settings: TrainingSettings | CriticSettings,
    side: int,
    calls: Calls,
    console: Console,
) -> Trained:
    """Evaluate the weights of `training` on other strips: a `side` x `side` grid, and
    by effect.
    """
    policy = training.policy
    effects: tuple[EffectErrors, ...] = ()
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
) -> "FeedbackTraining | CriticTraining":
    """Open the training of these `settings` in `folder`, new or to be resumed."""
    if isinstance(settings, TrainingSettings):
        from policies.train.search import FeedbackTraining

        return FeedbackTraining(settings, folder)
    from policies.adaptive.train.training import CriticTraining

    return CriticTraining(settings, folder)


UNTRANSFERRED, TRAINED, JOURNAL = "untransferred.npz", "adaptive.npz", "transfer"
SECONDS = 10.0  # of processor, a fold
TIME_LIMIT = 900.0  # s of wall time, after which a fold is set aside
COMPLETE_SHARE = 0.75  # share of the folds that must have come to their end


def _fold_drawn(number: int, seed: int, checkpoint: Path) -> Mapping[str, Any]:
    """Fold strip `number` of those drawn by `seed` through images, with the critic
    `checkpoint`.

    Returns a row of `FoldedBatch`, empty where the fold failed.
    """
    strip = random_strip(np.random.default_rng([seed, number]))
    with TemporaryDirectory() as name:
        configs = find_configs(None)
        request = Request(
            cell=configs.cell(),
            strip=configs.strip(unmeasured_name(strip.length, strip.thickness)),
            policy="adaptive",
            runs=Path(name),
            trial=Trial(plant=strip, seed=number),
            checkpoint=checkpoint,
            record=RecordingOptions("none"),
        )
        result = fold(request, calibration_of(request.cell))
        stored = read_run(Path(result.run)).result

    predicted = None if stored is None else stored.foretold
    if result.exit_code != 0 or predicted is None or result.displacement_true is None:
        return {}

    return {
        "displacement": result.displacement_true,
        "predicted": predicted.displacement,
        "sigma": predicted.sigma,
        "log_length": math.log(predicted.bending_length.value),
        "thickness": strip.thickness,
    }


def transfer(
    checkpoint: Path, folder: Path, seed: int, count: int, engine: Engine, meter: Meter
) -> dict[str, Any]:
    """Correct the critic in `checkpoint` by a bias fitted to `count` folds, and save
    it.

    Returns facts on the new checkpoint in `folder`, which keeps the finished folds:
    with them the same call resumes. Raises ConfigurationError where files cannot be
    used or most folds fail.
    """
    facts = {k: v for k, v in about(checkpoint).items() if k != THROUGH_IMAGES}
    critic = load_critic(checkpoint)
    make_folder(folder)
    save_critic(folder / UNTRANSFERRED, critic, facts)
    bias, quality = fit_transfer(_fold_all(folder, seed, count, engine, meter))
    correction = {"bias": bias.model_dump()}
    left_out = asdict(quality)
    origin = {
        "transfer": correction,
        "seed": seed,
        "code": code(),
        "left_out": left_out,
    }
    save_critic(folder / TRAINED, critic, facts | {THROUGH_IMAGES: origin})
    return {
        "checkpoint": str(folder / TRAINED),
        "transfer": correction,
        "left_out": left_out,
    }


def _fold_all(
    folder: Path, seed: int, count: int, engine: Engine, meter: Meter
) -> FoldedBatch:
    """Folds of `count` strips by the critic in `folder`; ConfigurationError where most
    fail.
    """
    bare = (folder / UNTRANSFERRED).resolve()
    of = digest(code(), sha256(bare.read_bytes()).hexdigest()[:12])
    parts = [
        Part(
            key=f"{seed}-{number:04d}",
            of=of,
            cost=SECONDS,
            function=_fold_drawn,
            arguments=(number, seed, bare),
        )
        for number in range(count)
    ]
    records = sorted(
        carry_out(parts, folder / JOURNAL, engine, meter), key=lambda r: r.key
    )
    rows = [record.outcome for record in records if record.outcome]
    if len(rows) < COMPLETE_SHARE * count:
        raise ConfigurationError(
            f"{folder}: {len(rows)} of {count} folds came to their end,"
            f" {COMPLETE_SHARE:.0%} are needed; see the reasons in its journal"
        )
    return FoldedBatch.from_rows(rows)
