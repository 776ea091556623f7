"""Commands on records: `cell runs`, `report` (pages), `note` (tags), `viz` (Rerun),
`replay`, and `learn` of what folds taught the cell.
"""

import csv
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.base.config.length import metres
from cell.base.config.places import find_configs
from cell.interface.cli.options import Configs, Json, Run, RunFolders, Runs
from cell.interface.cli.output import busy, notice, print_json, print_table, say
from cell.record.files import CALIBRATION, is_run, run_folder
from cell.report.words import plural
from drivers.base.errors import ConfigurationError, suggestion

if TYPE_CHECKING:
    from cell.base.config.cell import CellFile
    from cell.folding.experience import Memory
    from cell.record.listing import RunRow

MEGABYTE = 1e6
TAG = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
WORDS = ("show", "list", "forget", "off", "on")
LONGEST_EDGES = 0.1  # m, of an offset by a ruler

What = Annotated[
    str,
    typer.Argument(
        metavar="WHAT",
        help="show, list, forget, off, on, or a run that was measured by a ruler.",
    ),
]
ForgottenRun = Annotated[
    Path | None,
    typer.Argument(
        metavar="RUN", parser=run_folder, help="With forget: the one run to forget."
    ),
]


def runs(
    folder: Runs = Path("runs"),
    where: Annotated[
        str,
        typer.Option(
            help='Only runs for which this SQL holds, as "abs(displacement) > 0.01".'
        ),
    ] = "",
    sort: Annotated[
        str, typer.Option(help="Column to sort by, as edge_offset; -COLUMN downwards.")
    ] = "",
    as_csv: Annotated[
        bool, typer.Option("--csv", help="All columns as CSV, in SI units.")
    ] = False,
    html: Annotated[
        Path | None,
        typer.Option(help="Write the list there as one page with thumbnails."),
    ] = None,
    keep: Annotated[
        int | None, typer.Option(min=0, help="Keep only the newest this many.")
    ] = None,
    older_than: Annotated[
        float | None,
        typer.Option(
            min=0, max=36500, help="Keep only runs of this many days or less."
        ),
    ] = None,
    delete: Annotated[
        bool,
        typer.Option(
            "--delete", help="Really delete what --keep or --older-than name."
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """List the runs in a folder; with --keep or --older-than, the runs that --delete
    removes.
    """
    from cell.record.listing import list_runs, remove, to_prune
    from cell.record.manifest import manifests_in

    pruning = keep is not None or older_than is not None or delete
    if delete and html is not None:
        raise ConfigurationError("--keep, --older-than, --delete: go without --html")
    with busy("reading the runs"):
        rows = list_runs(folder, where, sort)
    for manifest in manifests_in(folder):
        if manifest.is_under_way:
            notice(str(manifest))
    if pruning:
        # a plan stays together
        rows = tuple(row for row in rows if row.folder.parent == folder)
        age = None if older_than is None else timedelta(days=older_than)
        rows = to_prune(rows, datetime.now(UTC), keep=keep, older_than=age)
    if html is not None:
        from cell.report.runs_page import write_runs_page

        page = write_runs_page(rows if sort else rows[::-1], html)
        print(f"{plural(len(rows), 'run')}\n  {page}")
        return
    _print_rows(rows, as_csv=as_csv, as_json=as_json)
    if pruning:
        said = f"{plural(len(rows), 'run')} may go; nothing was deleted, add --delete"
        if delete:
            freed = remove(rows) / MEGABYTE
            said = f"deleted {plural(len(rows), 'run')}, {freed:.1f} MB"
        print(said, file=sys.stderr)


def _print_rows(rows: "Sequence[RunRow]", *, as_csv: bool, as_json: bool) -> None:
    """Print the runs as CSV or JSON, by default as a table."""
    from cell.record.listing import COLUMNS, values_of

    if as_csv:
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(map(values_of, rows))
    elif as_json:
        print_json(*map(_row_facts, rows))
    else:
        _print_table(rows)


def _row_facts(row: "RunRow") -> dict[str, Any]:
    """JSON object of a listed run: lengths [m], duration [s], size [bytes], tags if
    any.
    """
    keys = (
        "strip",
        "policy",
        "outcome",
        "displacement",
        "edge_offset",
        "duration",
        "size",
    )
    facts: dict[str, Any] = {"run": str(row.folder), "began": row.began.isoformat()}
    facts |= {key: getattr(row, key) for key in keys}
    if row.tags or row.note:
        facts |= {"tags": row.tags.split(), "note": row.note}
    return facts


def _print_table(rows: "Sequence[RunRow]") -> None:
    """Print the runs as a table; tags have a column where any run has one."""
    columns = ["short", "strip", "policy", "outcome"]
    if any(row.tags for row in rows):
        columns.append("tags")
    shown = [
        (
            *(getattr(row, column) for column in columns),
            *row.offsets,
            f"{row.size / MEGABYTE:.1f}",
        )
        for row in rows
    ]
    head = ("run", *columns[1:], "d mm", "edge mm", "MB")
    print_table(head, shown, text=len(columns))


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN",
            parser=run_folder,
            help=(
                "Run folders, the ends of their names, or last; or the file of a"
                " calibration."
            ),
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Page that compares several runs [default: compare.html beside them]."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the HTML page of a run, finished or not; several runs are compared on one
    page.

    For the file of a calibration, write its page beside it.
    """
    if len(runs) > 1:
        _report_comparison(runs, out, as_json=as_json)
    elif out is not None:
        raise ConfigurationError(
            "--out: goes with several runs; one has its page in its folder"
        )
    elif runs[0].is_file() and (
        runs[0].name == CALIBRATION or not is_run(runs[0].parent)
    ):
        _report_calibration(runs[0], as_json=as_json)
    else:
        _report_run(runs[0], as_json=as_json)


def _report_comparison(
    runs: Sequence[Path], out: Path | None, *, as_json: bool
) -> None:
    """Write the page that compares `runs` to `out`, by default beside them, and print
    its path.
    """
    from cell.report.runs_page import write_comparison

    with busy("comparing the runs"):
        page = write_comparison(runs, out or runs[0].resolve().parent / "compare.html")
    say(
        {"runs": runs, "report": page},
        f"{len(runs)} runs compared\n  {page}",
        as_json=as_json,
    )


def _report_run(folder: Path, *, as_json: bool) -> None:
    """Write the page of the run in `folder`, and print its verdict and path."""
    from cell.record.run import read_broken_run
    from cell.report.page import write_page
    from cell.report.page_verdict import verdict

    with busy("writing the page"):
        run = read_broken_run(folder)
        page = write_page(run)
    for problem in run.problems:
        notice(problem)
    say({"run": folder, "report": page}, f"{verdict(run)}\n  {page}", as_json=as_json)


def _report_calibration(path: Path, *, as_json: bool) -> None:
    """Write the page of the calibration file at `path`, and print its path."""
    from cell.report.calibration_page import write_calibration_report

    if path.suffix not in (".yaml", ".yml"):
        raise ConfigurationError(
            f"{path}: is neither a run's folder nor a calibration's YAML file; see"
            " `cell runs`"
        )
    page = write_calibration_report(path)
    say({"calibration": path, "report": page}, str(page), as_json=as_json)


def note(
    runs: RunFolders,
    tag: Annotated[
        list[str] | None, typer.Option(help="A tag to add; repeatable.")
    ] = None,
    untag: Annotated[
        list[str] | None, typer.Option(help="A tag to remove; repeatable.")
    ] = None,
    text: Annotated[
        str | None, typer.Option(help="The note, in place of an earlier one.")
    ] = None,
) -> None:
    """Tag runs, or write a note on them; `cell runs` lists tags and notes."""
    from cell.record.documents import annotate
    from cell.record.files import check_run

    if not tag and not untag and text is None:
        raise ConfigurationError(
            "--tag, --untag, --text: give one at least, as --tag good"
        )
    for word in (*(tag or ()), *(untag or ())):
        if TAG.fullmatch(word) is None:
            raise ConfigurationError(
                f"--tag: {word!r} is no tag; use letters, digits, . - and _"
            )
    for run in runs:
        check_run(run)
    for run in runs:
        tags = annotate(run, tag or (), untag or (), text)
        print(f"{run}: {tags or 'no tags'}")


def viz(run: Run) -> None:
    """Write a run's recording for the viewer Rerun, and print how to open it."""
    from cell.record.run import read_broken_run
    from cell.report.viz.recording import viz_from_run

    with busy("writing the recording"):
        path = viz_from_run(run)
    for problem in read_broken_run(run).problems:
        notice(problem)
    print(f"{path}\n  open it with: rerun {quote(str(path))}")


def replay(run: Run, as_json: Json = False) -> None:
    """Repeat a run's perception and decisions from its record; exit code 1 if one
    differs.
    """
    with busy("repeating perception and decisions from the record"):
        from cell.folding.replay import replay as decide_again

        result = decide_again(run)
    text = "the same" if result.same else f"{len(result.differences)} differences"
    text = f"{result.images} images, {result.decisions} decisions: {text}"
    text = "\n  ".join([text, *result.differences])
    say({"run": run, **asdict(result)}, text, as_json=as_json)
    sys.exit(not result.same)


def learn(
    what: What = "show",
    run: ForgottenRun = None,
    edges: Annotated[
        str | None,
        typer.Option(help="Offset of the run's laid edges by a ruler, as 3.5mm."),
    ] = None,
    sure: Annotated[
        bool,
        typer.Option(
            "--sure", help="Believe the ruler, however far from the camera it is."
        ),
    ] = False,
    twin: Annotated[
        bool,
        typer.Option(
            "--twin", help="What folds of the twin taught, not of the real cell."
        ),
    ] = False,
    configs: Configs = None,
    as_json: Json = False,
) -> None:
    """Show or change what the cell has learned from folds, or enter a ruler's
    measurement.
    """
    _check_arguments(what, run, edges)
    from cell.folding.experience import Memory

    settings = find_configs(configs).cell()
    memory = Memory(settings.name, twin=twin)
    if edges is not None:
        _learn_from_ruler(settings, run_folder(what), edges, sure=sure)
    elif what == "forget":
        _forget(settings, memory, run)
    elif what == "list":
        from cell.folding.summary import experience_lines

        if as_json:
            print_json(*map(asdict, memory.experiences()))
        else:
            sys.stdout.write(experience_lines(memory.experiences()))
    elif what == "show":
        _show(memory, settings, as_json=as_json)
    else:
        memory.switch(on=what == "on")
        print(f"{settings.name}: learning is {what}")


def _check_arguments(what: str, run: Path | None, edges: str | None) -> None:
    """Raise ConfigurationError for arguments of `cell learn` that contradict each
    other.
    """
    if what not in WORDS and edges is None:
        raise ConfigurationError(
            f"{what!r}{suggestion(what, WORDS)} is neither show, list, forget, off nor"
            " on; a run goes with --edges, the offset of its laid edges by a ruler, as"
            " `--edges 3.5mm`"
        )
    if what in WORDS and edges is not None:
        raise ConfigurationError(
            "--edges: goes with a run, as `cell learn runs/RUN --edges 3.5mm`"
        )
    if run is not None and what != "forget":
        raise ConfigurationError(
            f"{run}: goes with forget alone, as `cell learn forget {run}`"
        )


def _memory_of(settings: "CellFile", run: Path) -> "Memory":
    """Memory that holds the fold `run`: the one of the twin or that of the real
    cell.
    """
    from cell.folding.experience import Memory

    twin = Memory(settings.name, twin=True)
    return twin if twin.find(run) else Memory(settings.name)


def _learn_from_ruler(
    settings: "CellFile", run: Path, edges: str, *, sure: bool
) -> None:
    """Learn from the ruler's offset `edges` of the laid edges of `run`."""
    from cell.folding.bias import check_ruler
    from cell.folding.experience import experience_by_ruler

    offset = metres("--edges", edges, LONGEST_EDGES)
    memory = _memory_of(settings, run)
    experience = experience_by_ruler(run, offset, memory)
    if not sure:
        check_ruler(offset, experience.rig)
    memory.add(experience)
    print(
        f"{run.name}: the ruler shows {1e3 * experience.rig:+.1f} mm more than the"
        " camera"
    )


def _forget(settings: "CellFile", memory: "Memory", run: Path | None) -> None:
    """Set aside what was learned from `run`, or everything."""
    if run is not None:
        memory = _memory_of(settings, run)
    aside = memory.forget(run)
    if aside is not None:
        print(f"set aside: {aside}")
    elif run is None:
        print("nothing was learned yet")
    else:
        raise ConfigurationError(
            f"{run}: nothing was learned from this run; `cell learn list` names those"
            " that taught"
        )


def _show(memory: "Memory", settings: "CellFile", *, as_json: bool) -> None:
    """Print the learned biases, by policy, strip and specimen."""
    from cell.folding.summary import largest_text, summary_rows, summary_text

    rows = summary_rows(memory.experiences())
    if as_json:
        print_json(*rows)
        return
    state = "off" if memory.is_off else settings.learning.use
    print(f"{settings.name}: learning is {state}")
    sys.stdout.write(summary_text(rows))
    if rows:
        sys.stdout.write(largest_text(memory))
