"""HTML pages on several runs: a list with thumbnails, and a comparison."""

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, cycle
from pathlib import Path
from typing import Any, Self

import numpy as np

from cell.record.columns import FARTHEST_HAND
from cell.record.files import FILM, REPORT
from cell.record.frames import read_index
from cell.record.listing import RunRow, read_row
from cell.record.run import Run, read_broken_run
from cell.report.drawing import (
    BLUE,
    GREEN,
    MUTED,
    ORANGE,
    PURPLE,
    RED,
    as_svg,
    canvas,
)
from cell.report.figures import NOTE, drawings
from cell.report.html import Card, Link, jpeg_text, page
from cell.report.overlay import ShownImages
from cell.report.page import (
    Rows,
    film_of,
    flatten,
    setting_text,
    stated_settings,
    truth_of,
)
from cell.report.page_verdict import FOLDED_TOLERANCE
from cell.report.words import (
    MINUS,
    NO_VALUE,
    PARAMETERS,
    millimetres,
    plain,
    plural,
    seconds,
)
from drivers.base.errors import ConfigurationError, in_mm
from drivers.base.outputs import write_output
from drivers.base.readers import read_picture

PICTURED = 300  # newest runs with a thumbnail; more would make the page heavy
THUMBNAIL_WIDTH = 128  # px
COLUMN_HEADINGS = (
    "run",
    "edges apart, mm",
    "at the touch, mm",
    "ended by",
    "policy",
    "strip",
    "s",
    "note",
)
COLOURS = (
    *(BLUE, ORANGE, GREEN, PURPLE, RED),
    "#4a9aa8",
    "#8c7a2b",
    "#c05a94",
)
MOST_RUNS = 40  # runs in one comparison; more lines cannot be distinguished
# runs of which films play side by side, and with a column each
MOST_FILMS, MOST_COLUMNS = 4, 4
TREND = 20  # newest folds of a strip that are drawn
NAMED = 4  # best runs that the verdict names
SHAPES = 4  # times at which the strips are drawn
PARTED = 0.002  # m between two grippers, from which their paths part
# Keys that differ from run to run by themselves, or repeat another one.
PER_RUN_KEYS = frozenset(
    {"index", "condition", "calibration.age_days", "cell.fold.speed"}
)


def write_runs_page(rows: Sequence[RunRow], out: Path) -> Path:
    """Write the HTML page that lists `rows` in this order, above them how their edges
    came out over time; ConfigurationError where it cannot.
    """
    by_time = sorted(rows, key=lambda row: row.began)
    pictured = {row.name for row in by_time[-PICTURED:]}
    text = page(
        "report/templates/runs.html",
        plural(len(rows), "run"),
        head=COLUMN_HEADINGS,
        wide=THUMBNAIL_WIDTH,
        trend=_trend_figure(by_time),
        rows=[
            (
                row.name[-4:],
                _thumbnail(row) if row.name in pictured else "",
                _cells(row, out.parent),
            )
            for row in rows
        ],
    )
    write_output(out, text)
    return out


def write_imported(
    folders: Sequence[Path], summaries: Rows, advice: str, out: Path
) -> Path:
    """Write the HTML page that draws the imported runs in `folders` to `out`, with
    `summaries` (name, text) of them and `advice` on what to do next; returns `out`.
    """
    title = f"{plural(len(folders), 'run')} imported"
    said = Card("good", title, (f"Next: {advice}.",))
    facts = {"said": said, "summaries": summaries, "runs": drawings(folders)}
    text = page("report/templates/imported.html", title, **facts)
    write_output(out, text)
    return out


def _trend_figure(rows: Sequence[RunRow]) -> str:
    """Figure (SVG) of the edges of `rows`, oldest first, fold by fold of a strip.

    Empty where no strip has two folds that laid their edges.
    """
    laid = [
        row
        for row in rows
        if row.edge_offset is not None and not row.policy.startswith("motion:")
    ]
    strips = Counter(row.strip for row in laid)
    repeated = sorted(strip for strip, count in strips.items() if count > 1)
    if not repeated:
        return ""
    with canvas(8.4, 1.9) as figure:
        axes = figure.add_subplot()
        axes.axhline(0, color=MUTED, lw=0.8)
        for strip, colour in zip(repeated, cycle(COLOURS), strict=False):
            folds = [row for row in laid if row.strip == strip][-TREND:]
            offsets = [1e3 * (row.edge_offset or 0.0) for row in folds]
            order = range(1, len(offsets) + 1)
            axes.plot(order, offsets, "o-", color=colour, ms=4, lw=1, label=strip)
            for number, offset, row in zip(order, offsets, folds, strict=True):
                axes.annotate(row.name[-4:], (number, offset), (3, 4), **NOTE)
        axes.set(
            xlabel="folds of the strip, oldest first (motions are none)",
            ylabel="edges apart  [mm]",
        )
        axes.xaxis.get_major_locator().set_params(integer=True)
        figure.legend(loc="outside upper left", ncols=6)
        return as_svg(figure)


def _cells(row: RunRow, folder: Path) -> tuple[str | Link, ...]:
    """Table cells of a run in the page that lists runs."""
    duration = "" if row.duration is None else f"{row.duration:.1f}"
    notes = " · ".join(filter(None, (row.tags, row.note)))
    lengths = (offset.replace("-", MINUS) for offset in row.offsets[::-1])
    outcome = plain(row.outcome)
    cells = (*lengths, outcome, row.policy, row.strip, duration, notes)
    return (_link(row, folder, row.short), *cells)


def _thumbnail(row: RunRow) -> str:
    """Last kept image of a run, small, as JPEG in text form; empty where none can be
    read.
    """
    try:
        images = [note.file for note in read_index(row.folder) if note.file is not None]
        image = read_picture(images[-1]) if images else None
    except ConfigurationError:
        return ""
    return "" if image is None else jpeg_text(image, THUMBNAIL_WIDTH, quality=60)


def write_comparison(folders: Sequence[Path], out: Path) -> Path:
    """Write the HTML page that compares the runs in `folders` to `out`; returns `out`.

    Raises ConfigurationError for a folder that is no run, more than `MOST_RUNS`, or a
    place that cannot be written.
    """
    if len(folders) > MOST_RUNS:
        raise ConfigurationError(
            f"{len(folders)} runs are too many for one page, at most {MOST_RUNS};"
            " choose with `cell runs --where`"
        )
    compared = [Compared.read(folder) for folder in folders]
    strips = sorted({one.run.header.strip for one in compared})
    title = f"{len(compared)} runs of {', '.join(strips)}"
    settings = _differences(compared)
    differing = [setting for setting, *_ in settings[1:]]
    if len(compared) > MOST_COLUMNS:
        settings = list(zip(*settings, strict=True))
    films = [
        (_caption(one), film_of(one.run, ShownImages.of(one.run)))
        for one in compared[:MOST_FILMS]
    ]
    text = page(
        "report/templates/compare.html",
        title,
        said=_verdict(compared, differing),
        films=[(name, film) for name, film in films if film and film["source"] != FILM],
        head=("run", "outcome", "displacement", "true", "edges apart", "true", "touch"),
        numbers=[_numbers(one, out.parent) for one in compared],
        differences=settings,
        shapes=_shapes(compared),
    )
    write_output(out, text)
    return out


@dataclass(frozen=True, slots=True)
class Compared:
    """Run in a comparison: a short `name`, its record, its `row` in lists, its `truth`
    if known.
    """

    name: str
    run: Run
    row: RunRow
    truth: Mapping[str, Any]

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the run in `folder`; ConfigurationError for a folder that is no run."""
        run = read_broken_run(folder)
        row = read_row(run.folder)
        policy = row.policy.removeprefix("motion:")
        return cls(
            f"{row.short.split()[0]} {policy}".strip(), run, row, truth_of(run)[0] or {}
        )


def _caption(compared: Compared) -> str:
    """Caption of a run's film."""
    row = compared.row
    return f"{row.short}  ·  {row.policy}  ·  layers touch at {seconds(row.touch)}"


def _verdict(compared: Sequence[Compared], differing: Sequence[str]) -> Card:
    """Verdict that names the run nearest to a fold in half, and the settings that
    differ.
    """
    rows = [one.row for one in compared]
    laid = all(
        row.edge_offset is not None for row in rows if row.displacement is not None
    )
    key, what = "displacement", "Displacement where the layers touch"
    if laid:  # one length for all runs
        key, what = "edge_offset", "Edges apart"
    measured = _nearest_first((one.name, getattr(one.row, key)) for one in compared)
    true = _nearest_first((one.name, one.truth.get(key)) for one in compared)
    if not measured:
        return Card("fair", "No run has a displacement", ())
    sentences = [
        f"{what}, by the camera: {_listed(measured)}; up to"
        f" {in_mm(FOLDED_TOLERANCE)} count as folded."
    ]
    if true:
        sentences.append(f"The simulated strip itself: {_listed(true)}.")
    sentences += _parting(compared)
    if differing:
        advice = (
            " Next: fold again with the first of these alone changed, then the next, to"
            " learn which makes the difference."
        )
        sentences.append(
            f"Set differently: {', '.join(differing)}.{advice if differing[1:] else ''}"
        )
    least = millimetres(abs(measured[0][1]))
    best = [
        name for name, offset in measured[:NAMED] if millimetres(abs(offset)) == least
    ]
    comes = "comes nearest" if len(best) == 1 else "come equally near"
    return Card(
        "good",
        f"{' and '.join(best)} {comes} to half: {least} off",
        tuple(sentences),
    )


def _parting(compared: Sequence[Compared]) -> list[str]:
    """Sentence on when and how far the grippers of the first two runs part before the
    layers touch; none where one has no motion.
    """
    pair = compared[:2]
    one, other = (each.run.ticks for each in pair)
    if min(one.t.size, other.t.size) == 0:
        return []
    touches = (each.row.touch for each in pair)
    t = one.t[one.t <= min(other.t[-1], *filter(None, touches))]
    beside = [np.interp(t, other.t, getattr(other, axis)) for axis in ("x", "z")]
    apart = np.hypot(one.x[: t.size] - beside[0], one.z[: t.size] - beside[1])
    most = int(np.argmax(apart))
    names = " and ".join(each.name for each in pair)
    if apart[most] < PARTED:
        return [f"The paths of {names} stay within {millimetres(apart[most])}."]
    begin = seconds(t[np.argmax(apart >= PARTED)])
    return [
        f"Before the layers touch, the paths of {names} separate {begin} after the"
        f" lift, and are farthest apart, {millimetres(apart[most])}, at"
        f" {seconds(t[most])}."
    ]


def _nearest_first(
    offsets: Iterable[tuple[str, float | None]],
) -> list[tuple[str, float]]:
    """Names of runs with their offsets [m], the smallest first; those without one are
    left out.
    """
    known = [(name, offset) for name, offset in offsets if offset is not None]
    return sorted(known, key=lambda one: (abs(one[1]), one))


def _listed(offsets: Sequence[tuple[str, float]]) -> str:
    """Text that names the first NAMED runs with their `offsets` [m]."""
    return ", ".join(
        f"{name}: {millimetres(d, signed=True)}" for name, d in offsets[:NAMED]
    )


def _numbers(compared: Compared, folder: Path) -> tuple[str | Link, ...]:
    """Table cells of a run in the comparison: outcome, lengths as measured and in
    truth, touch.
    """
    row, truth = compared.row, compared.truth
    lengths = (row.displacement, truth.get("displacement"), row.edge_offset)
    texts = (millimetres(v, signed=True) for v in (*lengths, truth.get("edge_offset")))
    return (
        _link(row, folder, compared.name),
        plain(row.outcome),
        *texts,
        seconds(row.touch),
    )


def _link(row: RunRow, folder: Path, name: str) -> str | Link:
    """Table cell with the `name` of a run, a link to its page where it has one."""
    report = row.folder / REPORT
    return Link(name, os.path.relpath(report, folder)) if report.exists() else name


def _differences(compared: Sequence[Compared]) -> list[tuple[str, ...]]:
    """Heading and rows of the settings that differ: a row per setting, a column per
    run.

    The plant is stated by its values where these are known.
    """
    settings = []
    for one in compared:
        contents = {
            "cell": one.run.header.config or {},
            "plant": one.truth.get("plant", {}),
        }
        settings.append(dict(stated_settings(one.run)) | dict(flatten(contents)))
    parts = [{key.partition(".")[0] for key in each} for each in settings]
    # a run of others states no cell, policy or versions
    shared = set.intersection(*parts)
    table = [("setting", *(one.name for one in compared))]
    for key in dict.fromkeys(chain(*settings)):
        differs = any(each.get(key) != settings[0].get(key) for each in settings)
        if differs and key not in PER_RUN_KEYS and key.partition(".")[0] in shared:
            table.append((_setting_title(key), *distinct_texts(key, settings)))
    return table


def _setting_title(key: str) -> str:
    """Words for the setting `key`, whose parts are joined by dots."""
    *groups, name = key.split(".")
    words = [*groups[:1], PARAMETERS[name]] if name in PARAMETERS else [*groups, name]
    return plain(" ".join(words)).replace("effects ", "")


def distinct_texts(key: str, settings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Texts of the setting `key` in each run; unrounded where rounded ones would be
    equal.
    """
    texts = [
        setting_text(key, each[key]) if key in each else NO_VALUE for each in settings
    ]
    return texts if len(set(texts)) > 1 else [str(each.get(key)) for each in settings]


def _shapes(compared: Sequence[Compared]) -> str:
    """Figure (SVG) of the lifted strips at equal times, and of the paths of the
    gripper.
    """
    with canvas(8.4, 4.0) as figure:
        axes = figure.add_subplot(aspect="equal", anchor="W")
        axes.axhline(0, color=MUTED, lw=0.8)
        stamps = [one.run.profile.t for one in compared]
        ends = [t.max() for t in stamps if t.size]
        times = np.linspace(0.0, min(ends, default=0.0), SHAPES + 1)[1:]
        for number, one in enumerate(compared):
            shade = COLOURS[number % len(COLOURS)]
            path = 1e3 * one.run.ticks.x, 1e3 * one.run.ticks.z
            axes.plot(*path, color=shade, lw=1.8, label=one.name)
            curves = one.run.profile.curves()
            for time in times if curves else ():
                _, points = min(curves, key=lambda curve: abs(curve[0] - time))
                is_near = (np.abs(points) < FARTHEST_HAND).all(axis=1)
                near = 1e3 * points[is_near]
                text = f"{time:.1f} s"
                axes.plot(*near.T, color=shade, lw=0.7, gid=f"{one.name}, {text}")
                if number == 0 and len(near):
                    axes.annotate(text, near[-1], (3, 0), **NOTE)
        axes.set(xlabel="x  [mm]", ylabel="z  [mm]")
        figure.legend(loc="outside lower left", ncols=2)
        return as_svg(figure)
