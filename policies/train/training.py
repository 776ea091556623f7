"""A training run in a folder: its journal, and the best weights so far."""

from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path as FilePath

from drivers.types import Array
from policies.checkpoint import Checkpoint, Training, save_checkpoint
from policies.train.folding import evaluator, validator
from policies.train.journal import Journal
from policies.train.search import Progress, Search
from policies.train.settings import TrainingSettings

JOURNAL, CHECKPOINT = "feedback.jsonl", "feedback.json"


class TrainingRun:
    """A training that begins in an empty folder, or resumes one of the same settings.

    `known` generations were done before. Raises ConfigurationError for a folder that cannot be
    written or holds something else.
    """

    def __init__(self, settings: TrainingSettings, folder: FilePath) -> None:
        journal = Journal(folder / JOURNAL, settings)
        self.settings = settings
        self.known = len(journal.generations)
        self.checkpoint = folder / CHECKPOINT
        self._search = Search(settings, journal)

    @property
    def weights(self) -> Array:
        """The best weights (WEIGHT_COUNT,) so far."""
        return self._search.weights

    def run(self, executor: Executor) -> Iterator[Progress]:
        """Run the remaining generations over `executor`; ends with the checkpoint saved.

        A checkpoint is also saved whenever a generation validates better than all before it.
        """
        search, done = self._search, self.known
        steps = search.run(evaluator(self.settings, executor), validator(self.settings, executor))
        for step in steps:
            done = step.generation + 1
            if step.validated == search.validated:
                self._save_checkpoint(done)
            yield step
        self._save_checkpoint(done)

    def _save_checkpoint(self, generations: int) -> None:
        training = Training(
            seed=self.settings.seed,
            generations=generations,
            folds=generations * self.settings.folds_per_generation,
        )
        weights = tuple(float(w) for w in self.weights)
        made = Checkpoint(schema=1, policy="feedback", weights=weights, training=training)
        save_checkpoint(self.checkpoint, made)
