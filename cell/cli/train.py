"""The command `cell train`: trains a policy in the simulation of the strip as a rod."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from cell.cli.options import Json, engine, print_json

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from cell.train.run import Trained


Learned = Literal["feedback", "adaptive"]


def train(
    policy: Annotated[Learned, typer.Option(help="Which policy to train.")] = "feedback",
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
    folds: Annotated[
        int, typer.Option(min=24, help="Folds through images that end the training of `adaptive`.")
    ] = 96,
    checkpoint: Annotated[
        Path | None, typer.Option(help="Trained weights of `adaptive`: only its folds are made.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Train a policy in the rod; judge it in the rod and on the chain.

    Generations, population and strips are those of `feedback`; `adaptive` has rounds of its own,
    and ends with folds of the chain through images that correct what the rod has taught it.
    Killed or interrupted, the same command goes on and ends with the same weights.
    """
    default = f"adaptive-{seed}" if policy == "adaptive" else f"seed-{seed}"
    folder = out or Path("runs/training") / default
    if checkpoint is not None:
        _only_adaptive(policy)
        _print_transfer(_transfer(checkpoint, folder, seed, folds, jobs, cluster), as_json=as_json)
        return
    size = {"generations": generations, "population": population, "strips": strips}
    trained = _train(policy, folder, seed, size, _workers(jobs, cluster), grid)
    corrected: dict[str, Any] = {}
    if policy == "adaptive":
        corrected = _transfer(trained.checkpoint, folder, seed, folds, jobs, cluster)
    if as_json:
        print_json(trained.line() | corrected)
        return
    from cell.cli.table import print_table
    from cell.train.evaluation import tables

    for table in tables(trained.evaluations, trained.effects):
        print_table(*table)
    if corrected:
        _print_transfer(corrected, as_json=False)
    sys.stdout.write(
        f"  fold with it: cell fold --strip denim --policy {policy} "
        f"--checkpoint {trained.checkpoint}\n"
    )


def _train(
    policy: Learned,
    folder: Path,
    seed: int,
    size: dict[str, int],
    workers: "AbstractContextManager[Executor]",
    grid: int,
) -> "Trained":
    """Train `policy` in the rod and evaluate it on a `grid`; `size` is for `feedback` alone."""
    from rich.console import Console

    from cell.extras import require_library

    require_library("torch" if policy == "adaptive" else "cmaes")
    from cell.train.run import train
    from policies.adaptive.train.shard import CriticSettings
    from policies.train.objective import TrainingSettings

    adaptive = policy == "adaptive"
    settings = CriticSettings(seed=seed) if adaptive else TrainingSettings(seed=seed, **size)
    return train(settings, folder, workers, grid, Console(stderr=True))


def _only_adaptive(policy: Learned) -> None:
    from drivers.errors import ConfigurationError

    if policy != "adaptive":
        raise ConfigurationError("--checkpoint: is for --policy adaptive; leave it out")


def _transfer(
    checkpoint: Path, folder: Path, seed: int, folds: int, jobs: int | None, cluster: str | None
) -> dict[str, Any]:
    """Correct the weights by `folds` folds through images; returns facts on the new checkpoint."""
    from rich.console import Console

    from cell.campaign.progress import Meter
    from cell.parallel import cores
    from cell.train.transfer import TIME_LIMIT, transfer
    from policies.adaptive.train.training import CHECKPOINT

    by = engine(jobs or (1 if cluster else cores()), cluster, TIME_LIMIT)
    out = folder / CHECKPOINT
    with Meter(Console(stderr=True)) as meter:
        found, quality = transfer(checkpoint, folder, out, seed, folds, by, meter)
    return {"checkpoint": str(out), "transfer": found.facts(), "left_out": asdict(quality)}


def _print_transfer(facts: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        print_json({"schema": 1, **facts})
        return
    held_out = facts["left_out"]
    sys.stdout.write(
        f"{held_out['folds']} folds through images; of folds left out the displacement is "
        f"{1e3 * held_out['rms']:.2f} mm rms off the prediction; {facts['checkpoint']}\n"
    )


def _workers(jobs: int | None, address: str | None) -> "AbstractContextManager[Executor]":
    from cell.campaign.cluster import executor
    from cell.parallel import cores, workers
    from drivers.errors import ConfigurationError

    if address is None:
        return workers(jobs or cores())
    if jobs is not None:
        raise ConfigurationError("--jobs: a cluster has its own workers; leave --jobs out")
    return executor(address)
