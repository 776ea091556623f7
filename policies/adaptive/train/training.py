"""Training of the critic in a folder: folds, critic of each round, final weights and
their trial.

It resumes with the shards and critics that are in the folder.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.files import writing
from drivers.base.types import Array, Calls
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic, save_critic
from policies.adaptive.critic import Critic, CriticPrediction, FoldMemory
from policies.adaptive.train.regression import fit
from policies.adaptive.train.shard import CriticSettings, Shard, concatenate, simulate
from policies.rollout import Misses
from policies.train.journal import JOURNALS, TrainingJournal

CHECKPOINT = "adaptive.npz"
LAST = 16  # kept decisions before the touch, about a second, on which sigmas are set
ONE, TWO = 1.0, 1.96
# share of outcomes, and sigmas that are to hold it
COVERAGES = ((0.68, ONE), (0.95, TWO))


class CriticTraining:
    """Training of the critic in a folder, resumed where the folder holds the same
    settings.

    At its end `trial` holds the results of the trial folds. Raises ConfigurationError
    for a folder of other settings, or one that cannot be written.
    """

    known = 0  # steps done before: those in the folder are passed at once

    def __init__(self, settings: CriticSettings, folder: FilePath) -> None:
        self.settings = settings
        self.folder = folder
        self.checkpoint = folder / CHECKPOINT
        self._critic: Critic | None = None  # of the last round
        TrainingJournal(folder / JOURNALS["adaptive"], settings, frozenset())

    @property
    def total(self) -> int:
        """Number of steps of the training: shards and regressions."""
        settings = self.settings
        return sum(settings.pieces) + settings.rounds + settings.trials

    @property
    def policy(self) -> Adaptive:
        """Policy `adaptive` with the critic of the training that has run to its end."""
        return Adaptive(self._calibrated)

    def run(self, calls: Calls) -> Iterator[str]:
        """Run the remaining steps, simulating folds by `calls`, and save the weights;
        yields a text on each step.
        """
        for number, text in enumerate(self._steps(calls), 1):
            yield f"{number} of {self.total}: {text}"
        self._finish()

    def _steps(self, calls: Calls) -> Iterator[str]:
        """Run all rounds and the trial folds; yields a text on each step."""
        settings = self.settings
        for turn, count in enumerate(settings.pieces):
            for shard in self._pieces(turn, count, calls):
                yield f"round {turn + 1}, shard {shard}"
            self._critic = self._fit(turn)
            yield f"round {turn + 1}, regression"
        for shard in self._pieces(settings.rounds, settings.trials, calls):
            yield f"trial {shard}"

    def _pieces(self, turn: int, count: int, calls: Calls) -> Iterator[int]:
        """Fold and store the missing shards of round `turn`; yields each shard's
        number.
        """
        missing = [n for n in range(count) if self._read(turn, n) is None]
        yield from sorted(set(range(count)) - set(missing))
        asked = [(self.settings, turn, n, self._critic) for n in missing]
        for i, shard in calls(simulate, asked):
            with writing(self.folder, "make room and go on"):
                shard.save(self._path(turn, missing[i]))
            yield missing[i]

    def _fit(self, turn: int) -> Critic:
        """Critic of round `turn`: the one in the folder, else fitted to all shards so
        far.
        """
        settings = self.settings
        path = self._critic_path(turn)
        if path.exists():
            return load_critic(path)

        stored = [(t, n) for t in range(turn + 1) for n in range(settings.pieces[t])]
        data = concatenate([self._load(t, n) for t, n in stored])
        epochs = settings.epochs[turn]
        critic = fit(data, settings, epochs, settings.seed, self._critic)
        save_critic(path, critic, {"round": turn})
        # as stored in float32, so that a resumed training is equal
        return load_critic(path)

    def _finish(self) -> None:
        """Scale the last critic's sigmas to its errors in the trial folds, and save the
        critic.
        """
        settings = self.settings
        shards = [self._load(settings.rounds, n) for n in range(settings.trials)]
        last = load_critic(self._critic_path(settings.rounds - 1))
        self._calibrated, self.trial = _calibrate_sigmas(last, concatenate(shards))
        facts = {
            "settings": settings.model_dump(mode="json"),
            "trial": asdict(self.trial),
        }
        save_critic(self.checkpoint, self._calibrated, {"training": facts})

    def _critic_path(self, turn: int) -> FilePath:
        return self.folder / f"critic-{turn}.npz"

    def _path(self, turn: int, number: int) -> FilePath:
        return self.folder / f"piece-{turn}-{number:02d}.npz"

    def _read(self, turn: int, number: int) -> Shard | None:
        try:
            return Shard.load(self._path(turn, number))
        except (OSError, ValueError, KeyError, EOFError):
            return None

    def _load(self, turn: int, number: int) -> Shard:
        """Stored shard `number` of round `turn`; ConfigurationError where it is
        broken.
        """
        shard = self._read(turn, number)
        if shard is None:
            raise ConfigurationError(
                f"{self._path(turn, number)}: cannot be read again; run the command"
                " again"
            )
        return shard


@dataclass(frozen=True, slots=True)
class TrialResult:
    """Statistics of the displacements of trial folds [m], and the shares of errors
    within 1 and 1.96 sigma.
    """

    folds: int
    untouched: int
    mean: float
    most: float
    worst: float
    within: tuple[float, float]


def _calibrate_sigmas(critic: Critic, shard: Shard) -> tuple[Critic, TrialResult]:
    """Copy of `critic` with sigmas scaled to its errors in trial folds; results of
    these folds.
    """
    ratios = _error_ratios(critic, shard)
    # sigma's factors with which the shares within 1 and 1.96 sigma are nearest to
    # normal
    needed = [
        [np.quantile(r, share) / sigmas for share, sigmas in COVERAGES] for r in ratios
    ]
    critic = critic.with_stretch(np.sqrt(np.prod(needed, axis=1)))
    at_touch = _error_ratios(critic, shard, last=1)[0]
    missed = Misses.from_displacements(shard.displacement)
    return critic, TrialResult(
        folds=len(shard.displacement),
        untouched=missed.untouched,
        mean=missed.mean,
        most=missed.quantile_95,
        worst=missed.worst,
        within=(float(np.mean(at_touch < ONE)), float(np.mean(at_touch < TWO))),
    )


def _error_ratios(critic: Critic, shard: Shard, last: int = LAST) -> list[Array]:
    """Four arrays (m,) of the critic's |error| / sigma in the `last` decisions of the
    folds.

    They are of the displacement and of the three properties of the strip.
    """
    ratios: list[list[Array]] = [[] for _ in range(4)]
    count = len(shard.displacement)
    memory = FoldMemory(count, critic.memory)
    # decisions from each to the touch
    to_touch = shard.alive[:, ::-1].cumsum(axis=1)[:, ::-1]

    for k in range(shard.alive.shape[1]):
        alive = shard.alive[:, k]
        whitened = critic.whiten(shard.inputs[:, k].astype(np.float64))
        remembered = memory.add(critic.memorise(whitened), alive)
        predicted = critic.predict(whitened, remembered)

        near = alive & (to_touch[:, k] <= last) & np.isfinite(shard.displacement)
        for collected, ratio in zip(ratios, _ratios(predicted, shard), strict=True):
            collected.append(ratio[near])
    return [np.concatenate(collected) for collected in ratios]


def _ratios(predicted: CriticPrediction, shard: Shard) -> list[Array]:
    """Ratios |error| / sigma (n,) of a prediction of n folds: displacement, then
    strip.
    """
    displacement = np.abs(shard.displacement - predicted.displacement) / predicted.sigma
    strip = [
        np.abs(true - estimate[:, 0]) / estimate[:, 1]
        for true, estimate in zip(shard.strip.T, predicted.belief, strict=True)
    ]
    return [displacement, *strip]
