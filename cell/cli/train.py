"""`cell train`."""

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.cli.options import Json

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from cell.train.critic import TrainedCritic
    from cell.train.run import Trained


class Learned(StrEnum):
    """Policies that are trained."""

    FEEDBACK = "feedback"
    ADAPTIVE = "adaptive"


def train(
    policy: Annotated[Learned, typer.Option(help="Which policy to train.")] = Learned.FEEDBACK,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the training [default: runs/training/seed-SEED].")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed and settings, same weights.")] = 0,
    generations: Annotated[int, typer.Option(min=1, help="Generations of CMA-ES.")] = 300,
    population: Annotated[int, typer.Option(min=4, help="Candidates a generation.")] = 48,
    strips: Annotated[
        int, typer.Option(min=1, help="Strips a side of the paper's range that each folds.")
    ] = 4,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes side by side [default: all cores].")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Fold on the Dask cluster at this address instead.")
    ] = None,
    grid: Annotated[
        int, typer.Option(min=2, help="Strips a side of the grid of the final evaluation.")
    ] = 12,
    as_json: Json = False,
) -> None:
    """Train a policy in the rod; judge it in the rod and on the chain.

    Generations, population and strips are those of `feedback`; `adaptive` has rounds of its own.
    Killed or interrupted, the same command goes on and ends with the same weights.
    """
    from rich.console import Console

    from cell.cli.table import wide_console
    from cell.train.critic import train_critic
    from cell.train.run import train as train_in
    from cell.train.screen import show
    from policies.adaptive.train.settings import CriticSettings
    from policies.train.settings import TrainingSettings

    workers, console = _workers(jobs, cluster), Console(stderr=True)
    trained: Trained | TrainedCritic
    if policy is Learned.ADAPTIVE:
        folder = out or Path("runs/training") / f"adaptive-{seed}"
        trained = train_critic(CriticSettings(seed=seed), folder, workers, grid, console)
    else:
        settings = TrainingSettings(
            seed=seed, generations=generations, population=population, strips=strips
        )
        folder = out or Path("runs/training") / f"seed-{seed}"
        trained = train_in(settings, folder, workers, grid, console)
    if as_json:
        sys.stdout.write(json.dumps(trained.line()) + "\n")
        return
    show(trained.evaluations, wide_console())
    sys.stdout.write(
        f"  fold with it: cell fold --strip denim --policy {policy.value} "
        f"--checkpoint {trained.checkpoint}\n"
    )


def _workers(jobs: int | None, address: str | None) -> "AbstractContextManager[Executor]":
    from cell.parallel import cores, workers
    from cell.train.cluster import cluster
    from drivers.errors import ConfigurationError

    if address is None:
        return workers(jobs or cores())
    if jobs is not None:
        raise ConfigurationError("--jobs: a cluster has its own workers; leave --jobs out")
    return cluster(address)
