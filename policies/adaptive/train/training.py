"""A resumable training of the critic in a folder: data, critic of each round, final weights."""

import json
from collections.abc import Iterator
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path as FilePath

from drivers.errors import ConfigurationError
from drivers.files import replace_file, writing
from drivers.readers import MEGABYTE, read_bytes
from policies.adaptive.checkpoint import load_critic, save_critic
from policies.adaptive.critic import Critic
from policies.adaptive.train.piece import Piece, concatenate, explore
from policies.adaptive.train.regression import fit
from policies.adaptive.train.settings import CriticSettings
from policies.adaptive.train.trial import Trial, calibrate_sigmas

SETTINGS, CHECKPOINT = "adaptive.json", "adaptive.npz"


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a training: `done` of `total` steps; `said` describes the last one."""

    done: int
    total: int
    said: str


class CriticTraining:
    """A training that begins in an empty folder, or continues one of the same settings.

    Raises ConfigurationError for a folder of other settings, or one that cannot be written.
    """

    def __init__(self, settings: CriticSettings, folder: FilePath) -> None:
        self.settings, self.folder = settings, folder
        self.checkpoint = folder / CHECKPOINT
        self._trial: Trial | None = None
        self._critic: Critic | None = None
        _check_settings(folder / SETTINGS, settings)

    @property
    def total(self) -> int:
        """Steps of the whole training: pieces and regressions."""
        return sum(self.settings.pieces) + self.settings.rounds + self.settings.trials

    @property
    def finished(self) -> Critic:
        """The critic of a completed training."""
        if self._critic is None or self._trial is None:
            raise RuntimeError("the training has not run to its end")
        return self._critic

    @property
    def tried(self) -> Trial:
        """The trial of a completed training."""
        if self._trial is None:
            raise RuntimeError("the training has not run to its end")
        return self._trial

    def run(self, executor: Executor) -> Iterator[Progress]:
        """Run the remaining steps, folds by `executor`; ends with the weights saved."""
        done = 0
        for turn in range(self.settings.rounds):
            for piece in self._pieces(turn, self.settings.pieces[turn], executor):
                done += 1
                yield Progress(done, self.total, f"round {turn + 1}, piece {piece}")
            self._critic = self._fit(turn)
            done += 1
            yield Progress(done, self.total, f"round {turn + 1}, regression")
        for piece in self._pieces(self.settings.rounds, self.settings.trials, executor):
            done += 1
            yield Progress(done, self.total, f"trial {piece}")
        self._finish()

    def _pieces(self, turn: int, count: int, executor: Executor) -> Iterator[int]:
        """Fold and store the missing pieces of round `turn`; yields each piece's number."""
        missing = [n for n in range(count) if self._read(turn, n) is None]
        yield from sorted(set(range(count)) - set(missing))
        jobs = {executor.submit(explore, self.settings, turn, n, self._critic): n for n in missing}
        for job in as_completed(jobs):
            self._store(job.result(), turn, jobs[job])
            yield jobs[job]

    def _fit(self, turn: int) -> Critic:
        path = self.folder / f"critic-{turn}.npz"
        if path.exists():
            return load_critic(path)
        stored = [(t, n) for t in range(turn + 1) for n in range(self.settings.pieces[t])]
        data = concatenate([self._load(t, n) for t, n in stored])
        seed, epochs = self.settings.seed, self.settings.epochs[turn]
        save_critic(path, fit(data, self.settings, epochs, seed, self._critic), {"round": turn})
        return load_critic(path)

    def _finish(self) -> None:
        """Set the critic's sigmas by the trials and save the weights."""
        rounds = self.settings.rounds
        pieces = [self._load(rounds, n) for n in range(self.settings.trials)]
        last = load_critic(self.folder / f"critic-{rounds - 1}.npz")
        self._critic, self._trial = calibrate_sigmas(last, concatenate(pieces))
        facts = {"settings": self.settings.model_dump(mode="json"), "trial": self._trial.facts()}
        save_critic(self.checkpoint, self._critic, {"training": facts})

    def _path(self, turn: int, number: int) -> FilePath:
        return self.folder / f"piece-{turn}-{number:02d}.npz"

    def _read(self, turn: int, number: int) -> Piece | None:
        try:
            return Piece.load(self._path(turn, number))
        except (OSError, ValueError, KeyError, EOFError):
            return None

    def _load(self, turn: int, number: int) -> Piece:
        piece = self._read(turn, number)
        if piece is None:
            raise ConfigurationError(
                f"{self._path(turn, number)}: cannot be read again; run the command again"
            )
        return piece

    def _store(self, piece: Piece, turn: int, number: int) -> None:
        with writing(self.folder, "make room and go on"):
            piece.save(self._path(turn, number))


def _check_settings(path: FilePath, settings: CriticSettings) -> None:
    """Write the settings into the folder, or refuse a folder that was begun with others."""
    asked = json.loads(settings.model_dump_json())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            replace_file(path, (json.dumps(asked, indent=1) + "\n").encode())
            return
        begun = json.loads(read_bytes(path, MEGABYTE))
    except OSError as error:
        raise ConfigurationError(
            f"{path}: cannot be used: {error.strerror}; name another output folder"
        ) from None
    except (UnicodeDecodeError, json.JSONDecodeError):
        begun = None
    if not isinstance(begun, dict):
        raise ConfigurationError(f"{path}: holds no settings of a training; name another folder")
    other = [name for name in asked if begun.get(name) != asked[name]]
    if other:
        changes = "; ".join(f"{name} was {begun.get(name)}, is {asked[name]}" for name in other)
        raise ConfigurationError(
            f"{path}: was begun with other settings: {changes}; use those, or another output folder"
        )
