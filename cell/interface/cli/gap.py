"""Commands `cell gap`: where simulation and measurements disagree, and which effect is
missing.
"""

import json
import os
import shlex
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.base.config.places import (
    Configs as Configurations,
    check_recordable,
    find_configs,
)
from cell.interface.cli.fold import progress_of
from cell.interface.cli.options import (
    INTERRUPTED_CODE,
    PLANT_HELP,
    Cluster,
    Configs,
    Json,
    RunFolders,
    Strip,
    ask,
    check_names,
    engine,
    folded_series,
    resumable,
)
from cell.interface.cli.output import (
    notice,
    print_json,
    print_table,
    say,
    working,
)
from cell.record.files import MANIFEST
from drivers.base.errors import ConfigurationError, in_mm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cell.folding.request import Request
    from cell.folding.series import Remainder
    from cell.gap.verdict.accept import AcceptResult

COPY_TIMEOUT = 3600.0  # s of a copy in which an effect is hidden

gap = typer.Typer(
    help=(
        "Find where simulation and measured data disagree, name the missing effect,"
        " add it."
    ),
    no_args_is_help=True,
)

StripFileName = Annotated[
    str | None,
    typer.Option("--strip", help="Strip by name, or a path to its file."),
]
Model = Annotated[
    Path | None,
    typer.Option("--model", help="The mechanism file, in place of a strip."),
]
Subject = Annotated[
    str | None,
    typer.Option(
        "--subject", help="A mechanism of the configuration by name: the cell's `arm`."
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="Simulations side by side; all cores if not given."),
]
Fitted = Annotated[
    Path, typer.Argument(metavar="DIR", help="The folder that a fit wrote.")
]

Plant = Annotated[str | None, typer.Option(help=f"{PLANT_HELP}.", metavar="PLANT")]
PlanFolder = Annotated[
    Path | None,
    typer.Option("--runs", help="New folder of these runs [runs/NAME-plan]."),
]
NoTruth = Annotated[
    bool, typer.Option("--no-truth", help="Keep the twin's truth out of the records.")
]
Resume = Annotated[
    bool,
    typer.Option("--resume", help="Go on with the plan in the folder of --runs."),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Say which runs would be made; move nothing.")
]


@gap.command()
def plan(
    strip: Strip,
    plant: Plant = None,
    runs: PlanFolder = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of run 0; run i uses seed + i.")
    ] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Runs side by side.")] = 1,
    configs: Configs = None,
    no_truth: NoTruth = False,
    resume: Resume = False,
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Fold the standard runs, by which `cell gap fit` identifies what a strip's model
    lacks.
    """
    found = find_configs(configs)
    check_names(found, strip)
    folder = runs or Path("runs") / f"{Path(strip).stem}-plan"
    _check_plan_folder(folder, resume=resume)
    if not dry_run:
        check_recordable(folder)
    requests = _standard_runs(found, strip, plant, folder, seed, truth=not no_truth)
    if dry_run:
        from cell.folding.request import standard_run

        for i, request in enumerate(requests):
            name, shows = standard_run(request)
            speed = request.speed
            facts = {"run": i, "name": name, "speed": speed, "shows": shows}
            text = f"{i:2d}  {name:15s} {speed:.2f} m/s  shows {shows}"
            say(facts, text, as_json=as_json)
        return
    file = _subject_file(strip, model=None, configs=configs, subject=None)
    words = ("cell", "gap", "fit", folder, "--strip", file, "--out", f"{folder}-fit")
    next_step = f"next: {shlex.join(map(str, words))}"
    code = _fold_all(requests, jobs, resuming=resume, as_json=as_json)
    if not as_json and code != INTERRUPTED_CODE:
        print(next_step)
    sys.exit(code)


def _check_plan_folder(folder: Path, *, resume: bool) -> None:
    """Refuse a folder of runs for a new plan, and one without a plan for --resume."""
    from cell.record.files import runs_in
    from cell.record.manifest import Manifest

    path = folder / MANIFEST
    if resume:
        if path.is_file():
            return
        raise ConfigurationError(
            f"--resume: no plan in {folder}; leave --resume out to begin one"
        )
    if path.is_file():
        manifest = Manifest.read(path)
        way_on = "wait for it" if manifest.is_under_way else "go on with --resume"
        raise ConfigurationError(
            f"--runs: {manifest}; {way_on}, or name a new folder for another plan"
        )
    if runs_in(folder):
        raise ConfigurationError(
            f"--runs: {folder} holds runs already; name a new folder, so that the"
            " standard runs stay together"
        )


def _standard_runs(
    found: Configurations,
    strip: str,
    plant: str | None,
    folder: Path,
    seed: int,
    *,
    truth: bool,
) -> "Sequence[Request]":
    """Requests of the standard runs of `strip` into `folder`, the `plant` on the desk
    if given.
    """
    from cell.base.devices.devices import Trial
    from cell.folding.request import RecordingOptions, Request, standard_requests
    from drivers.strip.describe import load_plant

    desk = None if plant is None else load_plant(found.plant_path(plant))
    record = RecordingOptions(truth=truth)
    trial = Trial(desk, seed)
    base = Request(
        cell=found.cell(),
        strip=found.strip(strip),
        policy="",
        runs=folder,
        trial=trial,
        record=record,
    )
    return standard_requests(base)


def _fold_all(
    requests: "Sequence[Request]", jobs: int, *, resuming: bool, as_json: bool
) -> int:
    """Fold the standard runs, or what is left of them, and print each result.

    Returns the largest exit code of all.
    """
    manifest = requests[0].runs / MANIFEST
    with folded_series(requests, "plan", manifest, resuming=resuming) as remainder:
        return _fold_remainder(remainder, jobs, as_json=as_json)


def _fold_remainder(remainder: "Remainder", jobs: int, *, as_json: bool) -> int:
    """Fold what is left of the standard runs and print each result; returns the exit
    code.
    """
    if not remainder.requests:
        return 0
    from cell.folding.batch import Callbacks, agreed, fold_all
    from cell.folding.request import standard_run
    from cell.setup.arm.run_settings import await_strip

    requests = agreed(remainder.requests, ask)
    code = 0
    callbacks = Callbacks(
        lay_again=lambda: await_strip(ask), begin=remainder.begin, end=remainder.end
    )
    if not as_json:
        callbacks = replace(callbacks, observe=progress_of)
    results = fold_all(requests, jobs, callbacks=callbacks)
    for request, result in zip(requests, results, strict=False):
        if not result.run:
            notice(result.reason)
            return result.exit_code
        if as_json:
            print_json(result.line())
        else:
            name, reveals = standard_run(request)
            outcome = result.outcome
            if result.displacement is not None:
                outcome += f", displacement {in_mm(result.displacement, 1)}"
            text = f"{name:15s} {outcome:32s} shows {reveals}  {result.run}"
            number = remainder.numbers[request.trial.seed] + 1
            print(f"{number}/{remainder.series.manifest.parts}  {text}")
        sys.stdout.flush()
        code = max(code, 0 if result.went_as_planned else result.exit_code)
    return code


@gap.command()
def rehearse(
    runs: RunFolders,
    strip: Strip,
    out: Annotated[Path, typer.Option("--out", help="Folder of outcomes and page.")],
    jobs: Annotated[int, typer.Option(min=1, help="Copies side by side.")] = 1,
    cluster: Cluster = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Hide each effect in turn in simulated copies of these runs: would a fit name the
    effect?

    Finished copies are kept in OUT: run the command again to resume.
    """
    from rich.console import Console

    from cell.base.campaign.progress import Meter
    from cell.gap import rehearse as rehearsal

    threads = _threads(jobs)
    chosen = engine(threads, cluster, COPY_TIMEOUT)
    console = None if as_json else Console(stderr=True)
    with resumable(out, rehearsal.JOURNAL):
        file = _subject_file(strip, model=None, configs=configs, subject=None)
        planned = rehearsal.rehearsal_plan(runs, file, threads)
        with Meter(console, rehearsal.progress_line) as meter:
            records = rehearsal.rehearse(planned, out, chosen, meter)
    page = rehearsal.write_page(planned, records, out)
    if as_json:
        print_json(json.loads((out / "rehearsal.json").read_text(encoding="utf-8")))
    else:
        sys.stdout.write(page.read_text(encoding="utf-8"))


@gap.command()
def fit(
    runs: RunFolders,
    out: Annotated[
        Path, typer.Option("--out", help="Folder for verdict, report and patches.")
    ],
    strip: StripFileName = None,
    model: Model = None,
    subject: Subject = None,
    hold_out: Annotated[
        list[str] | None, typer.Option(help="A run that only judges; repeatable.")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(help="An effect withheld from the library; repeatable."),
    ] = None,
    unchecked: Annotated[
        bool,
        typer.Option(
            "--unchecked", help="Fit recordings that `cell gap check` refuses."
        ),
    ] = False,
    jobs: Jobs = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Name the effects that a model lacks in measured runs; says so where runs cannot
    decide.
    """
    file = _subject_file(strip, model, configs, subject)
    from cell.gap.fit import FitOptions, fit as fit_runs
    from cell.gap.report.overlay import write_overlay
    from cell.gap.report.sentence import deviation_text

    options = FitOptions(
        hold_out=hold_out or (),
        without=without or (),
        unchecked=unchecked,
        jobs=_threads(jobs),
        cell_file=_cell_file(model, configs),
    )
    with working("reading", quiet=0.0) as shown:
        verdict = fit_runs(runs, file, out, options, shown, write_overlay)
    files = [f"  {out / name}" for name in ("report.html", "overlay.rrd")]
    deviations = [deviation_text(verdict.deviates)] if verdict.deviates else []
    text = "\n".join([*deviations, str(verdict), *files, f"next: {verdict.next}"])
    say(json.loads(verdict.to_json()), text, as_json=as_json)


@gap.command()
def check(
    runs: RunFolders,
    out: Annotated[
        Path, typer.Option("--out", help="Folder for check.json and check.html.")
    ],
    strip: StripFileName = None,
    model: Model = None,
    subject: Subject = None,
    jobs: Jobs = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Check recordings before a fit: samples, clocks, duplicates, and what the runs can
    show.

    Exit code 2 where `cell gap fit` refuses them.
    """
    from cell.gap.check import check as check_runs, check_page
    from cell.gap.subject.run_folders import find_runs
    from drivers.base.files import write_file
    from drivers.base.outputs import check_output_folder

    check_output_folder(out, "check.json", "fit.json")
    file = _subject_file(strip, model, configs, subject)
    with working("reading", quiet=0.0) as shown:
        checked = check_runs(runs, file, _threads(jobs), shown)
    write_file(out / "check.json", checked.to_json())
    drawn = []
    if strip:
        from cell.report.figures import drawings

        drawn = drawings([run.path for run in find_runs(runs)])
    write_file(out / "check.html", check_page(checked, file.stem, drawn))
    text = f"{checked}\n  {out / 'check.html'}"
    say(json.loads(checked.to_json()), text, as_json=as_json)
    sys.exit(ConfigurationError.exit_code if checked.level == "bad" else 0)


@gap.command()
def accept(
    fitted: Fitted,
    strip: StripFileName = None,
    model: Model = None,
    subject: Subject = None,
    law: Annotated[
        bool,
        typer.Option(
            "--law", help="Accept the law that describes what nothing explains."
        ),
    ] = False,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Accept what is suspected, where nothing is named."
        ),
    ] = False,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Write the named effects into the strip's file, or into cell.yaml if they are the
    cell's.

    For a mechanism: into an MJCF file beside its model; what MJCF cannot state, into
    its file.
    """
    from cell.gap.verdict.accept import accept as apply_patch
    from cell.gap.verdict.fit_folder import VERDICT
    from cell.gap.verdict.schema import read_verdict

    file = _subject_file(strip, model, configs, subject)
    changed = apply_patch(
        fitted, file, _cell_file(model, configs), law=law, force=force
    )
    step = read_verdict(fitted / VERDICT).next
    then = step.words.partition("; ")[2] if step else ""
    _print_changed("accepted", changed, then, as_json=as_json)


@gap.command()
def undo(
    fitted: Fitted,
    strip: StripFileName = None,
    model: Model = None,
    subject: Subject = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Restore the files to their state before `cell gap accept`."""
    from cell.gap.verdict.accept import undo as restore

    file = _subject_file(strip, model, configs, subject)
    changed = restore(fitted, file, _cell_file(model, configs))
    _print_changed("undone", changed, "", as_json=as_json)


def _print_changed(
    what: str, changed: "AcceptResult", then: str, *, as_json: bool
) -> None:
    """Print which effects `changed`, accepted or undone as `what` says, in which files,
    and what may be done `then`, if anything.
    """
    lines = [f"{what}: {', '.join(changed.effects)}", *map(str, changed.files)]
    text = "\n  ".join([*lines, then] if then else lines)
    say({what: changed.effects, "files": changed.files}, text, as_json=as_json)


@gap.command()
def replay(
    runs: RunFolders,
    model: Annotated[Path, typer.Option("--model", help="The mechanism file.")],
    mjcf: Annotated[
        Path,
        typer.Option(
            "--mjcf", help="The model that is compared with that of the file."
        ),
    ],
    jobs: Jobs = None,
    as_json: Json = False,
) -> None:
    """Replay runs of a mechanism with its model, and with another that is loaded
    alone: the gaps.
    """
    from cell.interface.handover import replay as replay_runs

    with working("reading", quiet=0.0) as shown:
        found = replay_runs(runs, model, mjcf, _threads(jobs), shown)
    if as_json:
        print_json(asdict(found))
        return
    columns = found.before, found.after, found.floor
    rows = [
        [name, *(f"{column.get(name, 0.0):.3g}" for column in columns)]
        for name in found.before
    ]
    print_table(("rms", "before", "after", "noise"), rows)
    for each in found.not_said:
        print(f"not said: {each}")


@gap.command()
def advise(fitted: Fitted, as_json: Json = False) -> None:
    """Print the further runs that would best separate the remaining explanations."""
    from cell.gap.report.sentence import remedy_lines
    from cell.gap.verdict.fit_folder import VERDICT, read_record
    from cell.gap.verdict.schema import fit_folder, read_verdict
    from drivers.base.files import lock_folders

    with lock_folders([fit_folder(fitted)]):
        record = read_record(fitted)
        verdict = read_verdict(fitted / VERDICT)
    if as_json:
        print(json.dumps(list(map(asdict, verdict.advice))))
        return
    for line in remedy_lines(record.scatter):
        print(line)
    if not verdict.advice:
        print("no experiment is worth more than those that were made")
    for item in verdict.advice:
        print(
            f"{item.experiment}: separates {' from '.join(item.separates)} by "
            f"{item.expected_sigma:.1f} sigma in {item.minutes:.1f} minutes"
        )


def _subject_file(
    strip: str | None, model: Path | None, configs: Path | None, subject: str | None
) -> Path:
    """File that --strip, --model or --subject names; ConfigurationError unless one is
    given.
    """
    if sum(given is not None for given in (strip, model, subject)) != 1:
        raise ConfigurationError(
            "--strip, --model, --subject: give exactly one: a strip by name or file,"
            " the file of a mechanism, or the name of a mechanism of the configuration"
        )
    if strip is not None:
        return _relative(find_configs(configs).strip_path(strip))
    if model is not None:
        return model
    return _relative(find_configs(configs).mechanism_path(str(subject)))


def _relative(file: Path) -> Path:
    """Path of `file` relative to the working directory, if the file lies below."""
    return file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file


def _threads(jobs: int | None) -> int:
    """Number of simulations side by side: `jobs`, but at most the number of cores."""
    cores = os.cpu_count() or 1
    return min(jobs or cores, cores)


def _cell_file(model: Path | None, configs: Path | None) -> Path | None:
    """Path of cell.yaml, None with a mechanism's `model`; ConfigurationError if
    unreadable.
    """
    if model is not None:
        return None
    found = find_configs(configs)
    found.cell()  # refused here, in one line, before anything is written
    return found.cell_path
