"""Training of the policy `feedback`: CMA-ES over the weights of its network, in a
folder.
"""

import hashlib
import time
from collections.abc import Iterator
from pathlib import Path as FilePath

import numpy as np
from cmaes import CMA
from threadpoolctl import ThreadpoolController

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array, Calls
from policies.feedback import (
    HIDDEN_UNITS,
    INPUT_CENTRE,
    INPUT_SPREAD,
    INPUTS,
    Checkpoint,
    Feedback,
    Training,
    save_checkpoint,
)
from policies.train.journal import JOURNALS, Line, TrainingJournal
from policies.train.objective import TrainingSettings, evaluate, validate

CHECKPOINT = "feedback.json"
REPLAYED = frozenset({"asked", "costs", "validated"})  # of a generation in the journal
APEX = 0.5  # of the strip's length, where the heading turns
TURN_LENGTH = 0.06  # of the strip's length, over which it turns
RISING, FALLING = 0.73, 1.25  # headings of the two legs, over pi


def initial_weights(rng: np.random.Generator) -> Array:
    """Initial weights (WEIGHT_COUNT,) of a network that folds along two straight legs.

    One hidden unit turns the heading phi = pi (1 + y / 2) where the gripper's x over
    the strip's length passes APEX: y = (FALLING + RISING - 2) - (FALLING - RISING)
    tanh((x - APEX) / TURN_LENGTH). The others have random inputs and no output.
    """
    input_weights = rng.normal(size=(HIDDEN_UNITS, INPUTS))
    hidden_biases = rng.normal(size=HIDDEN_UNITS)
    # the network whitens its inputs, so that x is the first row of the spread plus the
    # centre
    input_weights[0] = np.array(INPUT_SPREAD[0]) / TURN_LENGTH
    hidden_biases[0] = (INPUT_CENTRE[0] - APEX) / TURN_LENGTH
    output_weights = np.zeros(HIDDEN_UNITS)
    output_weights[0] = -(FALLING - RISING)
    output_bias = [FALLING + RISING - 2.0]
    return np.concatenate(
        [input_weights.ravel(), hidden_biases, output_weights, output_bias]
    )


class FeedbackTraining:
    """Training of the policy `feedback` by CMA-ES in a folder, resumed if its settings
    agree.

    `weights` (WEIGHT_COUNT,) are the optimiser's mean at its best validation so far.
    The optimiser's linear algebra is limited to one thread: its rounding depends on
    their number, and a training may be resumed on another machine. Raises
    ConfigurationError for a folder that cannot be written or holds something else.
    """

    trial = None  # of left-out folds; its validations stand in the journal

    def __init__(self, settings: TrainingSettings, folder: FilePath) -> None:
        self.settings = settings
        self.checkpoint = folder / CHECKPOINT
        self.weights: Array = initial_weights(np.random.default_rng(settings.seed))
        self.validated = np.inf
        self._journal = TrainingJournal(
            folder / JOURNALS["feedback"], settings, REPLAYED
        )
        self._blas = ThreadpoolController()
        self._last_validation = ""
        self._optimiser = CMA(
            mean=self.weights.copy(),
            sigma=settings.sigma,
            seed=settings.seed,
            population_size=settings.population,
        )

    @property
    def total(self) -> int:
        """Number of generations of the training."""
        return self.settings.generations

    @property
    def known(self) -> int:
        """Number of generations of the training that the journal holds."""
        return len(self._journal.lines)

    @property
    def policy(self) -> Feedback:
        """Policy `feedback` with the best weights so far."""
        return Feedback(self.weights)

    def run(self, calls: Calls) -> Iterator[str]:
        """Run the remaining generations, with folds by `calls`; yields a text on each.

        Those in the journal are replayed. A checkpoint is saved whenever a generation
        validates better than all before, and at the end.
        """
        for line in list(self._journal.lines):
            self._replay(line)
        while self._optimiser.generation < self.settings.generations:
            yield self._generation(calls)
        self._save_checkpoint()

    def _generation(self, calls: Calls) -> str:
        """Run one generation: ask, evaluate, update, validate if due, write to the
        journal.
        """
        number = self._optimiser.generation
        start = time.monotonic()
        candidates = self._ask()
        scores = evaluate(self.settings, candidates, number, calls)
        self._tell(candidates, scores.cost)
        validated = None
        if self._is_validated(number):
            [(_, validated)] = calls(validate, [(self.settings, self._optimiser.mean)])
            self._last_validation = f"  validated {1e3 * validated:.1f} mm rms"

        best = float(scores.miss.min())
        mean = float(scores.miss.mean())
        seconds = round(time.monotonic() - start, 3)
        self._journal.append(
            {
                "asked": _digest(candidates),
                "costs": scores.cost.tolist(),
                "generation": number,
                "best": best,
                "mean": mean,
                "validated": validated,
                "seconds": seconds,
            }
        )
        if validated is not None and self._keep_best(validated):
            self._save_checkpoint()

        return (
            f"generation {number + 1} of {self.total}  |d| best {1e3 * best:.1f} "
            f"mean {1e3 * mean:.1f} mm{self._last_validation}"
        )

    def _is_validated(self, number: int) -> bool:
        """Whether to validate generation `number`; only validated weights are kept."""
        last = number + 1 == self.settings.generations
        return last or (number + 1) % self.settings.validate_every == 0

    def _replay(self, line: Line) -> None:
        """Repeat the generation in `line` of the journal, with its costs instead of
        folds.
        """
        number = self._optimiser.generation
        candidates = self._ask()
        if _digest(candidates) != line["asked"]:
            raise ConfigurationError(
                f"{self._journal.path}: was written by other numerical libraries or"
                " another kind of processor; go on there, or begin again in another"
                " output folder"
            )
        self._tell(candidates, np.array(line["costs"]))
        # skips a former last one
        if line["validated"] is not None and self._is_validated(number):
            self._keep_best(line["validated"])

    def _ask(self) -> Array:
        with self._blas.limit(limits=1, user_api="blas"):
            return np.array(
                [self._optimiser.ask() for _ in range(self.settings.population)]
            )

    def _tell(self, candidates: Array, costs: Array) -> None:
        with self._blas.limit(limits=1, user_api="blas"):
            self._optimiser.tell(
                [
                    (candidate, float(c))
                    for candidate, c in zip(candidates, costs, strict=True)
                ]
            )

    def _keep_best(self, validated: float) -> bool:
        """Keep the optimiser's mean where its error `validated` [m] is the smallest so
        far; return whether it was kept.
        """
        if not validated < self.validated:
            return False
        self.validated = validated
        self.weights = self._optimiser.mean.copy()
        return True

    def _save_checkpoint(self) -> None:
        """Write the checkpoint of the best weights so far, and what they were trained
        on.
        """
        generation = self._optimiser.generation
        training = Training(
            seed=self.settings.seed,
            generations=generation,
            folds=generation * self.settings.folds_per_generation,
        )
        weights = tuple(float(w) for w in self.weights)
        checkpoint = Checkpoint(
            schema=1, policy="feedback", weights=weights, training=training
        )
        save_checkpoint(self.checkpoint, checkpoint)


def _digest(candidates: Array) -> str:
    return hashlib.sha256(candidates.tobytes()).hexdigest()[:16]
