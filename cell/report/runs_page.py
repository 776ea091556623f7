"""HTML pages on several runs: the list with thumbnails, and the comparison of some."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cell.record.files import REPORT
from cell.record.frames import decode, read_index
from cell.record.listing import RunRow, read_row
from cell.record.run import Run, read_broken_run
from cell.report.drawing import MUTED, as_svg, canvas
from cell.report.facts import facts
from cell.report.kit import Link, jpeg_text, page
from cell.report.verdict import Verdict
from cell.report.words import NO_VALUE, millimetres, plural, seconds
from drivers.errors import ConfigurationError
from drivers.files import write_file

PICTURED = 300  # newest runs with a thumbnail; more would make the page heavy
THUMBNAIL_WIDTH = 128  # px
COLUMN_HEADINGS = ("run", "strip", "policy", "outcome", "d mm", "edges mm", "s", "tags")
COLOURS = ("#2f6db5", "#cf6a1f", "#3a8a5c", "#8a5fb0", "#b4382c", "#4a9aa8", "#8c7a2b", "#c05a94")
MOST_RUNS = 40  # runs in one comparison; more lines cannot be distinguished
PER_RUN_KEYS = frozenset({"seed", "index"})  # which differ from run to run by themselves


def write_runs_page(rows: Sequence[RunRow], out: Path) -> Path:
    """Write the page that lists `rows`, oldest first, to `out`; returns its path.

    Raises ConfigurationError where it cannot be written.
    """
    write_file(out, runs_page(rows, out.parent))
    return out


def runs_page(rows: Sequence[RunRow], place: Path) -> str:
    """HTML page that lists `rows`, for a file in the folder `place`."""
    pictured = {row.name for row in rows[-PICTURED:]}
    return page(
        "report/templates/runs.html",
        plural(len(rows), "run"),
        title=plural(len(rows), "run"),
        head=COLUMN_HEADINGS,
        wide=THUMBNAIL_WIDTH,
        rows=[
            (_thumbnail(row) if row.name in pictured else "", _cells(row, place)) for row in rows
        ],
    )


def _cells(row: RunRow, place: Path) -> tuple[str | Link, ...]:
    report = row.folder / REPORT
    name = Link(row.name, os.path.relpath(report, place)) if report.exists() else row.name
    lengths = ("" if v is None else f"{1e3 * v:+.1f}" for v in (row.displacement, row.edge_offset))
    lasted = "" if row.duration is None else f"{row.duration:.1f}"
    outcome = row.outcome.replace("_", " ")
    return (name, row.strip, row.policy, outcome, *lengths, lasted, row.tags)


def _thumbnail(row: RunRow) -> str:
    """Last kept image of a run, small, as JPEG in text form; empty where none can be read."""
    try:
        kept = [note.file for note in read_index(row.folder) if note.file is not None]
        image = decode(kept[-1]) if kept else None
    except ConfigurationError:
        return ""
    return "" if image is None else jpeg_text(image, THUMBNAIL_WIDTH, quality=60)


def write_comparison(folders: Sequence[Path], out: Path) -> Path:
    """Write the page that compares the runs in `folders` to `out`, and return its path.

    Raises ConfigurationError for a folder that is no run, more than `MOST_RUNS`, or a place that
    cannot be written.
    """
    if len(folders) > MOST_RUNS:
        raise ConfigurationError(
            f"{len(folders)} runs are too many for one page, at most {MOST_RUNS}; choose with "
            "`cell runs --where`"
        )
    runs = [read_broken_run(folder) for folder in folders]
    write_file(out, comparison(runs, out.parent))
    return out


def comparison(runs: Sequence[Run], place: Path) -> str:
    """HTML page that compares `runs`, for a file in the folder `place`."""
    title = f"{len(runs)} runs of {', '.join(sorted({run.header.strip for run in runs}))}"
    settings, differences = _differences(runs)
    return page(
        "report/templates/compare.html",
        title,
        title=title,
        said=_verdict(runs),
        numbers=[_numbers(run, place) for run in runs],
        settings=settings,
        differences=differences,
        paths=_paths(runs),
        contacts=_contacts(runs),
    )


def _verdict(runs: Sequence[Run]) -> Verdict:
    found = [r.result.displacement for r in runs if r.result and r.result.displacement is not None]
    if not found:
        return Verdict("fair", "No run has a displacement", ())
    spread = millimetres(max(found) - min(found))
    mean = millimetres(float(np.mean(found)), signed=True)
    mean_text = f"{len(found)} of {len(runs)} runs have one; their mean is {mean}."
    return Verdict("good", f"Displacements lie within {spread} of one another", (mean_text,))


def _numbers(run: Run, place: Path) -> tuple[str | Link, ...]:
    row = read_row(run.folder)
    report = run.folder / REPORT
    href = os.path.relpath(report, place)
    return (
        Link(row.name, href) if report.exists() else row.name,
        row.policy,
        NO_VALUE if row.seed is None else str(row.seed),
        row.outcome.replace("_", " "),
        millimetres(row.displacement, signed=True),
        millimetres(row.edge_offset, signed=True),
        seconds(row.touch),
        seconds(row.duration, 1),
    )


def _differences(runs: Sequence[Run]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heading and rows of the settings that differ: a row per setting, a column per run."""
    settings = [dict(facts(run)) | dict(_flatten(run.header.config or {}, "cell")) for run in runs]
    keys = dict.fromkeys(key for each in settings for key in each if key not in PER_RUN_KEYS)
    rows = [(key, *(each.get(key, NO_VALUE) for each in settings)) for key in keys]
    heading = ("setting", *(_short_name(run) for run in runs))
    return heading, [row for row in rows if len(set(row[1:])) > 1]


def _flatten(content: object, prefix: str) -> Iterator[tuple[str, str]]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _flatten(value, f"{prefix}.{key}")
    else:
        yield prefix, str(content)


def _paths(runs: Sequence[Run]) -> str:
    with canvas(8.4, 4.0) as figure:
        axes = figure.add_subplot(aspect="equal", anchor="W")
        axes.axhline(0, color=MUTED, lw=0.8)
        for number, run in enumerate(runs):
            axes.plot(1e3 * run.ticks.x, 1e3 * run.ticks.z, **_line(number, run))
        axes.set(xlabel="x  [mm]", ylabel="z  [mm]")
        figure.legend(loc="outside lower left", ncols=2)
        return as_svg(figure)


def _contacts(runs: Sequence[Run]) -> str:
    with canvas(8.4, 3.4) as figure:
        axes = figure.add_subplot()
        for number, run in enumerate(runs):
            seen = np.isfinite(run.ticks.contact_x)
            axes.plot(run.ticks.t[seen], 1e3 * run.ticks.contact_x[seen], **_line(number, run))
            if run.result is not None and run.result.t_layer_touch is not None:
                axes.axvline(
                    run.result.t_layer_touch, color=_colour(number), lw=0.8, ls=(0, (3, 2))
                )
        axes.set(xlabel="t  [s]", ylabel="contact x  [mm]")
        return as_svg(figure)


def _line(number: int, run: Run) -> dict[str, object]:
    return {"color": _colour(number), "lw": 1.2, "label": _short_name(run)}


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _short_name(run: Run) -> str:
    """Short name of a run for headings: its last four characters, policy and seed."""
    seed = "" if run.header.seed is None else f"#{run.header.seed}"
    return " ".join(filter(None, (run.name[-4:], run.header.policy, seed)))
