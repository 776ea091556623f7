"""CMA-ES over the weights of the feedback network."""

import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np
from cmaes import CMA
from threadpoolctl import ThreadpoolController

from drivers.errors import ConfigurationError
from drivers.types import Array
from policies.network import HIDDEN_UNITS, INPUT_CENTRE, INPUT_SPREAD, INPUTS
from policies.train.journal import Journal, Line
from policies.train.objective import Scores
from policies.train.settings import TrainingSettings

Evaluate = Callable[[Array, int], Scores]  # of candidates (p, WEIGHT_COUNT) in a generation
Validate = Callable[[Array], float]  # weights (WEIGHT_COUNT,) -> rms d [m] over strips kept apart


APEX = 0.5  # of the strip's length, where the heading turns
TURN_LENGTH = 0.06  # of the strip's length, over which it turns
RISING, FALLING = 0.73, 1.25  # headings of the two legs, over pi


def first_weights(rng: np.random.Generator) -> Array:
    """Initial weights (WEIGHT_COUNT,): one unit turns the heading at the apex, others do nothing.

    y = (FALLING + RISING - 2) - (FALLING - RISING) tanh((x - APEX) / TURN_LENGTH),
    phi = pi (1 + y / 2).
    """
    input_weights = rng.normal(size=(HIDDEN_UNITS, INPUTS))
    hidden_biases = rng.normal(size=HIDDEN_UNITS)
    # the network whitens its inputs, so that x is the first row of the spread plus the centre
    input_weights[0] = np.array([1.0, 0.0, 0.0]) @ np.array(INPUT_SPREAD) / TURN_LENGTH
    hidden_biases[0] = (INPUT_CENTRE[0] - APEX) / TURN_LENGTH
    output_weights = np.zeros(HIDDEN_UNITS)
    output_weights[0] = -(FALLING - RISING)
    output_bias = [FALLING + RISING - 2.0]
    return np.concatenate([input_weights.ravel(), hidden_biases, output_weights, output_bias])


@dataclass(frozen=True, slots=True)
class Progress:
    """State of the search after a generation: mean |d| [m] of its `best` candidate and of all
    (`mean`), `validated` rms d [m] where it was measured, wall time `seconds` that it took.
    """

    generation: int
    best: float
    mean: float
    validated: float | None
    seconds: float


class Search:
    """Search by CMA-ES; `weights` are the optimiser's mean at its best validation so far.

    The optimiser's linear algebra is limited to one thread: its rounding depends on their number,
    and a training may be resumed on another machine.
    """

    def __init__(self, settings: TrainingSettings, journal: Journal) -> None:
        self.settings = settings
        self.weights: Array = first_weights(np.random.default_rng(settings.seed))
        self.validated = np.inf
        self._journal = journal
        self._blas = ThreadpoolController()
        self._optimiser = CMA(
            mean=self.weights.copy(),
            sigma=settings.sigma,
            seed=settings.seed,
            population_size=settings.population,
        )

    def run(self, evaluate: Evaluate, validate: Validate) -> Iterator[Progress]:
        """Run the remaining generations, one at a time; those in the journal are replayed."""
        for line in list(self._journal.generations):
            self._replay(line)
        while self._optimiser.generation < self.settings.generations:
            yield self._generation(evaluate, validate)

    def _generation(self, evaluate: Evaluate, validate: Validate) -> Progress:
        """Run one generation: ask, evaluate, update, validate if due, write to the journal."""
        number = self._optimiser.generation
        start = time.monotonic()
        asked = self._ask()
        scores = evaluate(asked, number)
        self._tell(asked, scores.cost)
        validated = None
        if self._is_validated(number):
            validated = validate(self._optimiser.mean)
            self._keep_best(validated)
        progress = Progress(
            generation=number,
            best=float(scores.miss.min()),
            mean=float(scores.miss.mean()),
            validated=validated,
            seconds=round(time.monotonic() - start, 3),
        )
        self._journal.append(
            {"asked": _digest(asked), "costs": scores.cost.tolist(), **asdict(progress)}
        )
        return progress

    def _is_validated(self, number: int) -> bool:
        """Whether to validate this generation; only validated weights are kept."""
        last = number + 1 == self.settings.generations
        return last or (number + 1) % self.settings.validate_every == 0

    def _replay(self, line: Line) -> None:
        """Repeat the generation in `line` of the journal, with its costs instead of folds."""
        number, asked = self._optimiser.generation, self._ask()
        if _digest(asked) != line["asked"]:
            raise ConfigurationError(
                f"{self._journal.path}: was written by other numerical libraries or another kind "
                "of processor; go on there, or begin again in another output folder"
            )
        self._tell(asked, np.array(line["costs"]))
        if line["validated"] is not None and self._is_validated(number):  # skips a former last one
            self._keep_best(line["validated"])

    def _ask(self) -> Array:
        with self._blas.limit(limits=1, user_api="blas"):
            return np.array([self._optimiser.ask() for _ in range(self.settings.population)])

    def _tell(self, asked: Array, costs: Array) -> None:
        with self._blas.limit(limits=1, user_api="blas"):
            self._optimiser.tell([(x, float(c)) for x, c in zip(asked, costs, strict=True)])

    def _keep_best(self, validated: float) -> None:
        if validated < self.validated:
            self.validated = validated
            self.weights = self._optimiser.mean.copy()


def _digest(asked: Array) -> str:
    return hashlib.sha256(asked.tobytes()).hexdigest()[:16]
