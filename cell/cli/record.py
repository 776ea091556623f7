"""Commands on records: `cell report` (pages), `note` (tags), `replay` and `viz` (Rerun)."""

import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Json, Run, RunFolders, busy, print_json, run_folder, say
from cell.record.files import CALIBRATION, is_run
from drivers.errors import ConfigurationError


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN",
            parser=run_folder,
            help="Run folders, the ends of their names, or last; or the file of a calibration.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Page that compares several runs [default: compare.html beside them]."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write report.html for a run, finished or not; several runs are compared on one page.

    The file of a calibration has a page of its own beside it.
    """
    if len(runs) > 1:
        from cell.report.runs_page import write_comparison

        with busy("comparing the runs"):
            page = write_comparison(runs, out or runs[0].resolve().parent / "compare.html")
        text = f"{len(runs)} runs compared\n  {page}"
        say({"runs": runs, "report": page}, text, as_json=as_json)
        return
    if out is not None:
        raise ConfigurationError("--out: goes with several runs; one has its page in its folder")
    folder = runs[0]
    if folder.is_file() and (folder.name == CALIBRATION or not is_run(folder.parent)):
        _report_calibration(folder, as_json=as_json)
        return
    from cell.record.run import read_broken_run
    from cell.report.page import write_page
    from cell.report.verdict import verdict

    with busy("writing the page"):
        run = read_broken_run(folder)
        page = write_page(run)
    for problem in run.problems:
        sys.stderr.write(f"cell: {problem}\n")
    say({"run": folder, "report": page}, f"{verdict(run)}\n  {page}", as_json=as_json)


def _report_calibration(path: Path, *, as_json: bool) -> None:
    from cell.report.calibration_page import write_calibration_report

    if path.suffix not in (".yaml", ".yml"):
        raise ConfigurationError(
            f"{path}: is neither a run's folder nor the YAML file of a calibration; `cell runs` "
            "lists the runs"
        )
    page = write_calibration_report(path)
    say({"calibration": path, "report": page}, str(page), as_json=as_json)


TAG = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def note(
    runs: RunFolders,
    tag: Annotated[list[str] | None, typer.Option(help="A tag to add; repeatable.")] = None,
    untag: Annotated[list[str] | None, typer.Option(help="A tag to remove; repeatable.")] = None,
    text: Annotated[str | None, typer.Option(help="The note, in place of an earlier one.")] = None,
) -> None:
    """Tag runs, or write a note on them; both are kept in the run and found by `cell runs`."""
    from cell.record.files import check_run
    from cell.record.notes import annotate

    if not tag and not untag and text is None:
        raise ConfigurationError("--tag, --untag, --text: give one at least, as --tag good")
    for word in (*(tag or ()), *(untag or ())):
        if TAG.fullmatch(word) is None:
            raise ConfigurationError(f"--tag: {word!r} is no tag; use letters, digits, . - and _")
    for run in runs:
        check_run(run)
    for run in runs:
        tags = annotate(run, tag or (), untag or (), text)
        sys.stdout.write(f"{run}: {tags or 'no tags'}\n")


def viz(run: Run) -> None:
    """Write the Rerun recording of a run from its record, and say how to open it."""
    from cell.record.run import read_broken_run
    from cell.report.viz.recording import viz_from_run

    with busy("writing the recording"):
        path = viz_from_run(run)
    for problem in read_broken_run(run).problems:
        sys.stderr.write(f"cell: {problem}\n")
    sys.stdout.write(f"{path}\n  open it with: rerun {path}\n")


def replay(run: Run, as_json: Json = False) -> None:
    """Repeat a run's perception and decisions from its record; exit code 1 if a result differs."""
    with busy("repeating perception and decisions from the record"):
        from cell.folding.replay import replay as decide_again

        result = decide_again(run)
    if as_json:
        facts = {"run": run, "images": result.images, "decisions": result.decisions}
        print_json({**facts, "differences": result.differences})
    else:
        text = "the same" if result.same else f"{len(result.differences)} differences"
        sys.stdout.write(f"{result.images} images, {result.decisions} decisions: {text}\n")
        sys.stdout.writelines(f"  {line}\n" for line in result.differences)
    sys.exit(0 if result.same else 1)
