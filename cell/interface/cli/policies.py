"""Commands `cell train` and `cell benchmark` of policies, and `cell twin serve` of the
arm.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from cell.base.config.places import find_configs
from cell.interface.cli.options import (
    Cluster,
    Configs,
    Json,
    engine,
    length_option,
    resumable,
    taking,
)
from cell.interface.cli.output import print_json, print_table, say
from drivers.base.errors import ConfigurationError, in_mm

if TYPE_CHECKING:
    from cell.studies.training import Trained
    from policies.adaptive.train.shard import CriticSettings
    from policies.train.objective import TrainingSettings

PART_TIMEOUT = 7200.0  # s of a part of the benchmark

TrainedPolicy = Literal["feedback", "adaptive"]


@dataclass(frozen=True, slots=True)
class TrainOptions:
    """Options of the command `cell train`."""

    policy: Annotated[TrainedPolicy, typer.Option(help="Which policy to train.")] = (
        "feedback"
    )
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the training [default: runs/training/seed-SEED]."),
    ] = None
    seed: Annotated[
        int, typer.Option(min=0, help="Same seed and settings, same weights.")
    ] = 0
    generations: Annotated[int, typer.Option(min=1, help="Generations of CMA-ES.")] = (
        300
    )
    population: Annotated[int, typer.Option(min=4, help="Candidates a generation.")] = (
        48
    )
    strips: Annotated[
        int,
        typer.Option(min=1, help="Strips a side of the paper's range that each folds."),
    ] = 4
    jobs: Annotated[
        int | None,
        typer.Option(min=1, help="Processes side by side [default: all cores]."),
    ] = None
    cluster: Annotated[
        str | None,
        typer.Option(help="Fold on the Dask cluster at this address instead."),
    ] = None
    grid: Annotated[
        int,
        typer.Option(min=2, help="Strips a side of the grid of the final evaluation."),
    ] = 12
    folds: Annotated[
        int,
        typer.Option(
            min=24, help="Folds through images that end the training of `adaptive`."
        ),
    ] = 96
    checkpoint: Annotated[
        Path | None,
        typer.Option(help="Trained weights of `adaptive`: only its folds are made."),
    ] = None
    as_json: Json = False

    def folder(self) -> Path:
        """Folder of the training: --out, or one named by policy and seed."""
        name = "adaptive" if self.policy == "adaptive" else "seed"
        return self.out or Path("runs/training") / f"{name}-{self.seed}"

    def settings(self) -> "TrainingSettings | CriticSettings":
        """Settings of the training; `adaptive` has rounds of its own."""
        from policies.adaptive.train.shard import CriticSettings
        from policies.train.objective import TrainingSettings

        if self.policy == "adaptive":
            return CriticSettings(seed=self.seed)
        return TrainingSettings(
            seed=self.seed,
            generations=self.generations,
            population=self.population,
            strips=self.strips,
        )


@taking(TrainOptions)
def train(given: TrainOptions) -> None:
    """Train a policy in the rod simulation; evaluate it in the rod and the chain
    simulation.

    Generations, population and strips are those of `feedback`; `adaptive` has rounds of
    its own, and ends with folds of the chain through images, which correct what it
    learned in the rod. After an interruption run the command again to resume; the
    weights are the same.
    """
    is_adaptive = given.policy == "adaptive"
    checkpoint = given.checkpoint
    if checkpoint is not None and not is_adaptive:
        raise ConfigurationError("--checkpoint: is for --policy adaptive; leave it out")
    from rich.console import Console

    from cell.base.campaign.processes import cores
    from cell.base.campaign.progress import Meter
    from drivers.base.extras import require_library

    if checkpoint is None:
        require_library("torch" if is_adaptive else "cmaes")
    from cell.studies.training import (
        TIME_LIMIT,
        UNTRANSFERRED,
        train as train_in,
        transfer,
    )
    from policies.train.journal import JOURNALS

    folder = given.folder()
    jobs = given.jobs or (1 if given.cluster else cores())
    workers = engine(jobs, given.cluster, TIME_LIMIT)
    console = Console(stderr=True)
    trained: Trained | None = None
    corrected: dict[str, Any] = {}
    with resumable(folder, *JOURNALS.values(), UNTRANSFERRED):
        if checkpoint is None:
            trained = train_in(given.settings(), folder, workers, given.grid, console)
            checkpoint = trained.checkpoint
        if is_adaptive:
            with Meter(console) as meter:
                corrected = transfer(
                    checkpoint,
                    folder,
                    given.seed,
                    count=given.folds,
                    engine=workers,
                    meter=meter,
                )
    if given.as_json:
        line = {"schema": 1} if trained is None else trained.record()
        print_json(line | corrected)
    else:
        _print_training(given.policy, trained, corrected)


def _print_training(
    policy: str, trained: "Trained | None", corrected: Mapping[str, Any]
) -> None:
    """Print the evaluation of the `trained` weights, if any, and of their correction,
    if any.
    """
    from cell.studies.evaluation import tables

    if trained is not None:
        for table in tables(trained.evaluations, trained.effects):
            print_table(*table)
    if corrected:
        held_out = corrected["left_out"]
        print(
            f"{held_out['folds']} folds through images; of folds left out the"
            f" displacement is {in_mm(held_out['rms'], 2)} rms off the prediction;"
            f" {corrected['checkpoint']}"
        )
    if trained is not None:
        print(
            f"  fold with it: cell fold --strip denim --policy {policy} "
            f"--checkpoint {trained.checkpoint}"
        )


@dataclass(frozen=True, slots=True)
class BenchmarkOptions:
    """Options of the command `cell benchmark`."""

    policies: Annotated[
        str | None, typer.Option(help="Policies, with commas [default: all].")
    ] = None
    strips: Annotated[
        str | None, typer.Option(help="Strips, with commas [default: all].")
    ] = None
    repeat: Annotated[
        int | None,
        typer.Option(min=1, help="Folds of one strip by each policy [default: 5]."),
    ] = None
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the noise; repeats use the next.")
    ] = 0
    jobs: Annotated[int, typer.Option(min=1, help="Parts measured side by side.")] = 1
    cluster: Cluster = None
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path(
        "runs/benchmark"
    )
    runs: Annotated[
        Path | None,
        typer.Option(help="Folder in which folds are recorded [default: OUT/runs]."),
    ] = None
    configs: Configs = None
    quick: Annotated[
        bool, typer.Option("--quick", help="Three strips, two repeats, coarse grids.")
    ] = False
    again: Annotated[
        bool, typer.Option("--again", help="Measure anew what OUT already holds.")
    ] = False
    picture: Annotated[
        Path | None, typer.Option(help="Write the main picture there too, as PNG.")
    ] = None
    as_json: Json = False


@taking(BenchmarkOptions)
def benchmark(given: BenchmarkOptions) -> None:
    """Fold all strips by all policies, and compare the results with the paper's
    numbers.

    Finished parts are kept in OUT: after an interruption run the command again to
    resume.
    """
    out = given.out
    picture = given.picture
    from rich.console import Console

    from cell.base.campaign.progress import Meter
    from cell.base.campaign.run import carry_out
    from cell.studies.page import lines, write_main_picture, write_results
    from cell.studies.parts import JOURNAL, benchmark as measured, summarise
    from cell.studies.results import BenchmarkSpec, split
    from cell.studies.summary import claim_lines, tables
    from drivers.base.outputs import check_output

    if picture is not None:
        check_output(picture)
    found = find_configs(given.configs)
    names = (split(given.policies), split(given.strips))
    spec = BenchmarkSpec.build(
        found, *names, given.repeat, given.seed, quick=given.quick
    )
    workers = engine(given.jobs, given.cluster, PART_TIMEOUT)
    progress = Meter(Console(stderr=True), summarise)
    with resumable(out, JOURNAL), progress as meter:
        measure = partial(
            carry_out,
            folder=out / JOURNAL,
            engine=workers,
            meter=meter,
            again=given.again,
        )
        results = measured(spec, found, given.runs or out / "runs", measure)
    page = write_results(results, out)
    if picture is not None:
        write_main_picture(results, picture)
    if given.as_json:
        print_json(*lines(results))
        return
    for table in tables(results):
        print_table(*table)
    for line in (*claim_lines(results), page):
        print(f"  {line}")


twin = typer.Typer(
    help="The digital twin of the arm, for unmodified clients of the real one.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@twin.callback()
def the_twin() -> None:
    """Digital twin of the arm, for unmodified clients of the real one."""


@twin.command()
def serve(
    address: Annotated[
        str | None,
        typer.Option(
            help="IPv4 address to listen at [default: a free one on the loopback]."
        ),
    ] = None,
    lock_step: Annotated[
        bool,
        typer.Option(
            "--lock-step/--wall-clock",
            help=(
                "A motion advances with its client's commands, or by the clock at 1"
                " kHz."
            ),
        ),
    ] = True,
    faults: Annotated[
        Path | None,
        typer.Option(help="File with faults that strike at scripted ticks."),
    ] = None,
    between: Annotated[
        float | None,
        length_option(
            "--between",
            "Thickness of what the fingers close on, as 0.9mm [mm].",
            "mm",
            0.0,
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Emulate arm (port 1337) and hand (port 1338) until interrupted; no strip is
    simulated, and the fingers close on nothing unless told.
    """
    from drivers.base.settings import parse
    from drivers.twin.fci_server.faults import load_faults
    from drivers.twin.fci_server.server import RobotServer, ServerSettings

    given = {"lock_step": lock_step} | ({} if address is None else {"address": address})
    settings = parse(given, ServerSettings, "cell twin serve")
    scheduled = () if faults is None else load_faults(faults)
    server = RobotServer(settings, between=lambda: between, faults=scheduled)
    host = server.address
    clock = "lock-step" if lock_step else "wall clock"
    facts = {"address": host, "arm": 1337, "hand": 1338, "clock": clock}
    say(facts, f"arm at {host}:1337, hand at {host}:1338, {clock}", as_json=as_json)
    if not ip_address(host).is_loopback:
        print(
            f"{host} is no loopback address: others on the network can connect",
            file=sys.stderr,
        )
    sys.stdout.flush()
    try:
        server.serve()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
