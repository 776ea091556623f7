"""`python -m policies.train --out DIR`: train the feedback policy; a killed run goes on."""

import argparse
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path as FilePath

import numpy as np

from drivers.errors import CellError
from drivers.types import Array
from policies.checkpoint import Checkpoint, Training, save_checkpoint
from policies.train.folding import evaluator, grid_folds, scored, validator
from policies.train.journal import Journal
from policies.train.search import Progress, Search
from policies.train.settings import TrainingSettings

EXAMINATION = 12  # strips a side of the final grid


def train(settings: TrainingSettings, out: FilePath, threads: int) -> Array:
    """Train into `out`: journal `feedback.jsonl`, checkpoint `feedback.json`; the weights."""
    search = Search(settings, Journal(out / "feedback.jsonl", settings))
    took: list[float] = []
    with ThreadPoolExecutor(threads) as pool:
        for step in search.run(evaluator(settings, pool), validator(settings)):
            took.append(step.seconds)
            if step.validated is not None:
                left = (settings.generations - 1 - step.generation) * float(np.mean(took))
                print(told(step, settings, left), flush=True)
    save_checkpoint(out / "feedback.json", checkpoint(search.weights, settings))
    return search.weights


def told(step: Progress, settings: TrainingSettings, left: float) -> str:
    """One line about a generation, `left` [s] to go."""
    validated = step.validated if step.validated is not None else float("nan")
    return (
        f"generation {step.generation + 1:4d} of {settings.generations}: "
        f"best {1e3 * step.best:5.1f} mm, mean {1e3 * step.mean:5.1f} mm, "
        f"validated {1e3 * validated:5.1f} mm, about {left:4.0f} s left"
    )


def checkpoint(weights: Array, settings: TrainingSettings) -> Checkpoint:
    """The weights and where they come from."""
    return Checkpoint(
        schema=1,
        policy="feedback",
        weights=tuple(float(w) for w in weights),
        training=Training(
            seed=settings.seed,
            generations=settings.generations,
            folds=settings.generations * settings.folds_per_generation,
        ),
    )


def examine(weights: Array, settings: TrainingSettings) -> None:
    """Print |d| over a grid that training never saw."""
    folds = grid_folds(weights, EXAMINATION, settings, seed=settings.seed + 1)
    d = 1e3 * np.abs(scored(folds))
    print(
        f"{EXAMINATION} x {EXAMINATION} strips: mean {d.mean():.1f} mm, "
        f"95 % {np.quantile(d, 0.95):.1f} mm, worst {d.max():.1f} mm, "
        f"without a touch {np.count_nonzero(~folds.touched)}"
    )


def main(arguments: list[str]) -> int:
    """Exit code of the command."""
    parser = argparse.ArgumentParser(prog="python -m policies.train", description=__doc__)
    parser.add_argument("--out", type=FilePath, required=True, help="folder of journal and weights")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    for name in ("seed", "generations", "population", "strips"):
        default = TrainingSettings.model_fields[name].default
        parser.add_argument(f"--{name}", type=int, default=default)
    given = vars(parser.parse_args(arguments))
    out, threads = given.pop("out"), given.pop("threads")
    settings = TrainingSettings(**given)
    try:
        examine(train(settings, out, threads), settings)
    except CellError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
