"""Commands `cell import` and `cell export` of runs, and `cell observe` of films."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from cell.base.config.places import Configs as Found, find_configs
from cell.interface.cli.options import Configs, Json, Strip, check_names
from cell.interface.cli.output import busy, notice, print_json, say
from cell.record.files import run_folder, runs_in
from cell.report.words import plural
from drivers.base.errors import ConfigurationError


def import_runs(
    places: Annotated[
        list[Path],
        typer.Argument(
            metavar="PLACE",
            help=(
                "A table or a folder of a run's tables, an MCAP file, or a LeRobot data"
                " set."
            ),
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder in which the runs are written; of --guess, a file."),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(
            help="File that says which column holds what; exported runs have their own."
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            help=(
                "File of the mechanism whose runs these are, not folds; with --guess"
                " its MJCF or URDF, beside which robot.yaml is drafted."
            )
        ),
    ] = None,
    guess: Annotated[
        bool,
        typer.Option("--guess", help="Propose a mapping, ./mapping.yaml, instead."),
    ] = False,
    strip: Annotated[
        str | None,
        typer.Option(help="Strip of a guess: its length tells units and zeros."),
    ] = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Convert tables of other programs to run folders, checked and ready for `cell gap
    fit`.
    """
    found = find_configs(configs)
    if guess:
        _propose(places, out or Path("mapping.yaml"), strip, model, found)
        return
    if out is None:
        raise ConfigurationError("--out: is missing; name the folder of the runs")

    with busy("reading the tables"):
        made = _convert(
            paths=places, mapping=mapping, out=out, model=model, found=found
        )

    if as_json:
        print_json(*({"run": folder} for folder in made))
    else:
        _print_imported(made, out, model)


def _print_imported(made: Sequence[Path], out: Path, model: Path | None) -> None:
    """Print the runs `made` in the folder `out`, and what to do with them."""
    summaries = [(folder.name, _summary(folder)) for folder in made]
    for name, summary in summaries:
        print(f"{name}: {summary}")
    count = len(runs_in(out))
    print(f"{plural(count, 'run')} in {out}")

    of = "--model", str(model)
    if model is None:
        from cell.record.run import read_run

        of = "--strip", read_run(made[0]).header.strip
    words = ("cell", "gap", "check", str(out), *of, "--out", f"{out}-check")
    advice = f"`{shlex.join(words)}`"
    if count == 1:
        advice = (
            f"import a second run into {out}, better ten: a verdict needs some to test"
            " it"
        )
    if model is None:
        from cell.report.runs_page import write_imported

        page = write_imported(made, summaries, advice, out / "imported.html")
        print(f"  {page}")
    print(f"next: {advice.strip('`')}")


def _propose(
    paths: list[Path],
    target: Path,
    strip: str | None,
    model: Path | None,
    found: Found,
) -> None:
    """Write a mapping, guessed from the first of `paths`, to the new file `target`, and
    beside a `model` the file of its mechanism; print them.
    """
    from drivers.base.files import check_free, write_file

    words = ["cell", "import", *(path for path in paths if path.suffix != ".json")]
    files = [target]
    if model is not None:
        files.insert(0, model.with_name("robot.yaml"))
        words += ["--model", files[0]]
    if model is None:
        from cell.record.exchange.guess import guess_mapping

        texts = [guess_mapping(paths, None if strip is None else found.strip(strip))]
    else:
        from cell.gap.draft import draft_mechanism

        with busy("comparing the runs with the model"):
            draft = draft_mechanism(model, paths)
        texts = [draft.robot(), draft.mapping()]
    for file in files:
        check_free(file)
    for file, text in zip(files, texts, strict=True):
        write_file(file, text)
        print(f"{text}{file}: read it, and write what is open in place of null")
    words += ["--mapping", target, "--out", "runs/own"]
    print(f"next: {shlex.join(map(str, words))}")


def _convert(
    paths: list[Path],
    mapping: Path | None,
    out: Path,
    model: Path | None,
    found: Found,
) -> tuple[Path, ...]:
    """Import the runs in `paths` to `out`: folds, or runs of the mechanism in the file
    `model`.
    """
    from cell.record.exchange.import_runs import import_runs as convert
    from cell.record.exchange.mapping import SignalMapping

    remarks: list[str] = []
    if model is not None:
        from cell.gap.subject.mechanism.read_mechanism import open_file, read_checked
        from cell.gap.subject.run_folders import RunFolder

        mechanism = open_file(model)
        made = convert(
            paths,
            mapping,
            out,
            lambda run: read_checked(RunFolder(run, run.name), mechanism),
            SignalMapping,
            tell=notice,
        )
        remarks = _contradictions(model, made)
    else:
        from cell.gap.subject.strip.runs import check_fold

        known = found.strip_names()
        made = convert(
            paths,
            mapping,
            out,
            lambda run: remarks.extend(check_fold(known, found.strip, run)),
            length=lambda name: found.strip(name).length,
            tell=notice,
        )
    for remark in remarks:
        notice(remark)
    return made


def _contradictions(model: Path, runs: Sequence[Path]) -> list[str]:
    """Lines on imported `runs` that contradict the mechanism in the file `model`."""
    from cell.gap.open_subject import open_mechanism
    from cell.gap.subject.run_folders import RunFolder

    try:
        subject = open_mechanism(model, [RunFolder(run, run.name) for run in runs])
    except ConfigurationError as error:  # the runs stay, and the fit says the same
        return [str(error)]
    return [*map(str, subject.contradictions())]


def _summary(folder: Path) -> str:
    """Text on an imported run: duration [s], and rows and columns, or a fold's images
    and touch.
    """
    from cell.gap.subject.run_table import read_table
    from cell.record.files import SIGNALS
    from cell.record.run import read_run

    if (table := folder / SIGNALS).is_file():
        columns = read_table(table)
        t = columns.pop("t")
        return f"{t[-1] - t[0]:.2f} s; {len(t)} rows of {', '.join(columns)}"
    run = read_run(folder)
    touch = None if run.result is None else run.result.t_layer_touch
    seen = "no touch" if touch is None else f"touch at {touch:.2f} s"
    images = plural(len(set(run.profile.t.tolist())), "image")
    return f"{run.ticks.t[-1]:.2f} s; {images}, {seen}"


def export_runs(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN",
            help="Runs, or folders of runs; of a model strips, or the folder of a fit.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="New folder for the files.")],
    kind: Annotated[
        Literal["lerobot", "mcap", "csv", "mjcf", "newton", "ranges"],
        typer.Option(
            "--format",
            help=(
                "Of runs a LeRobot set, MCAP, or CSV; of strips a model; of a fit its"
                " model (mjcf), or the ranges of its values."
            ),
        ),
    ] = "lerobot",
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Write runs for other programs, with exact time stamps, or strips and what fits
    found as simulation models.
    """
    from cell.interface.handover import export_fit
    from cell.record.exchange.export_runs import export_runs as convert
    from cell.setup.strips.export_strip import export_strips

    with busy("writing the files"):
        match kind:
            case "ranges" | "mjcf" if kind == "ranges" or Path(runs[0]).is_dir():
                if len(runs) > 1:
                    raise ConfigurationError(
                        f"{runs[1]}: a fit is exported alone; give one folder"
                    )
                made = export_fit(Path(runs[0]), kind, out)
            case "mjcf" | "newton":
                strips = [find_configs(configs).strip(name) for name in runs]
                made = export_strips(strips, kind, out)
            case _:
                made = dict.fromkeys(
                    convert([run_folder(name) for name in runs], kind, out), ()
                )
    for path, unsaid in made.items():
        facts = {"file": path} | ({"not_said": unsaid} if unsaid else {})
        say(facts, "\n  not said: ".join([str(path), *unsaid]), as_json=as_json)


def observe(
    film: Annotated[
        Path,
        typer.Argument(
            metavar="FILM", help="Film of a fold by a camera that stands still."
        ),
    ],
    strip: Strip,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Calibration of that camera at that place, from `cell calibrate`."
        ),
    ] = None,
    board: Annotated[
        bool,
        typer.Option("--board", help="The film begins with the printed board instead."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="New run folder [default: runs/NAME of the film]."),
    ] = None,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Measure a fold on a film: writes a run folder, and the film with what was
    measured.

    The strip lies flat and still as the film begins. No arm need be in view.
    """
    check_names(find_configs(configs), strip)
    if board == (calibration is not None):
        raise ConfigurationError("observe: give either --board or --calibration FILE")
    from cell.folding.observe import observe as read
    from cell.record.files import OVERLAY

    folder = out or Path("runs") / film.stem
    with busy("reading the film") as tell:
        found = read(
            film,
            calibration,
            strip,
            folder,
            configs,
            lambda time: tell(f"reading the film: {time:.1f} s"),
        )
    displacement: float | None = None
    text = "no touch of the layers was seen"
    if found.touch is not None:
        displacement = round(found.touch.displacement, 6)
        text = f"displacement {1e3 * displacement:+.1f} mm"
    facts = {
        "run": folder,
        "images": found.images,
        "read": found.read,
        "displacement": displacement,
    }
    text = (
        f"{film}: {found.read} of {found.images} images read; {text}\n  {folder}\n"
        f"  {folder / OVERLAY}"
    )
    say(facts, text, as_json=as_json)
