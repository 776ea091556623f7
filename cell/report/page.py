"""The HTML page of a run."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cell.record.files import (
    CALIBRATION,
    FILM,
    OVERLAY,
    PROFILE,
    RECORDING,
    REPORT,
    RUN,
    TICKS,
    is_under_way,
)
from cell.record.listing import runs_before
from cell.record.outlook import Outlook
from cell.record.run import Run
from cell.record.salvage import Salvage
from cell.record.truth import read_truth
from cell.report.facts import advice, checks, facts, listed_events, measures, remains
from cell.report.figures import signals_figure, strip_figure
from cell.report.markup import (
    Link,
    definitions,
    drawing,
    film,
    masthead,
    page,
    photographs,
    section,
    steps,
    table,
    verdict_box,
)
from cell.report.outlook import outlook_figure, predictions
from cell.report.overlay import end_picture, key_pictures
from cell.report.silhouettes import Silhouette, silhouettes
from cell.report.timing import timing_figure
from cell.report.verdict import verdict_of
from cell.report.words import millimetres
from drivers.errors import ConfigurationError
from drivers.files import replace_file, writing

FILES = (
    (RECORDING, "the fold in Rerun: rerun run.rrd"),
    (FILM, "the film of the camera, in step with frames/index.jsonl"),
    (OVERLAY, "the film with what was read in it"),
    (CALIBRATION, "the camera's calibration; cell report calibration.yaml draws it"),
    (TICKS, "gripper, contact and force over time"),
    (PROFILE, "the strip in every image"),
    (RUN, "settings and versions"),
)
RECENT = 8  # earlier runs that a page names
EARLIER = ("run", "policy", "outcome", "displacement", "edges apart")


def write_report(folder: Path, *, ended: bool = False) -> Path:
    """Write report.html into the run's folder and return its path.

    `ended` says that the run is over although its writer still holds the folder.

    A run that died or is damaged is reported as far as it can be read. Raises ConfigurationError
    for a folder without a readable run.yaml, or one that cannot be written.
    """
    run = Salvage.of(folder)
    path = folder / REPORT
    with writing(path):
        replace_file(path, report(run, ended=ended).encode(errors="backslashreplace"))
    return path


def report(run: Run, *, ended: bool = False) -> str:
    """The page of `run`; `ended` as for `write_report`."""
    return page(f"{run.header.strip} · {run.name}", list(_parts(run, ended=ended)))


def _parts(run: Run, *, ended: bool) -> Iterator[str]:
    policy = f", policy {run.header.policy}" if run.header.policy else ""
    kicker = f"Fold of {run.header.strip}{policy}"
    yield masthead(kicker, run.name)
    under_way = not ended and is_under_way(run.folder)
    truth, spoilt = _truth(run)
    said = verdict_of(run, truth, under_way)
    outlines = silhouettes(run)
    end = end_picture(run) if said.figure else ""
    yield verdict_box(said.tone, said.headline, said.sentences, said.figure, said.error, end)
    if spoilt:
        yield section("What could not be read", steps(spoilt))
    if run.result is None and not under_way and not said.spoilt:
        yield section("What to do", steps(advice(run)))
        yield section("What is here", definitions(remains(run), "rows"))
    yield section("In numbers", definitions(measures(run), "tiles"))
    yield from _outlook(run)
    yield from _pictures(run, outlines)
    yield section("Checks before the motion", table(("check", "result", "why"), checks(run)))
    yield section("What happened", table(("t [s]", "event", ""), listed_events(run)))
    yield section("Files beside this page", table(("file", "holds"), _files(run)))
    yield section("Earlier runs of this strip", table(EARLIER, list(_earlier(run))))
    yield section("Made with", definitions(facts(run), "rows"))


def _earlier(run: Run) -> Iterator[tuple[str | Link, ...]]:
    """The newest runs beside this one that began before it, with a link to their pages."""
    for row in runs_before(run.folder, run.header.strip, RECENT):
        lengths = (millimetres(v, signed=True) for v in (row.displacement, row.edge_offset))
        path = f"../{row.name}/{REPORT}"
        name = Link(row.name, path) if (row.folder / REPORT).exists() else row.name
        yield (name, row.policy, row.outcome.replace("_", " "), *lengths)


def _truth(run: Run) -> tuple[Mapping[str, Any] | None, list[str]]:
    """The truth, if readable, and the problems of the folder."""
    spoilt = list(run.problems) if isinstance(run, Salvage) else []
    try:
        return read_truth(run.folder), spoilt
    except ConfigurationError as error:
        return None, [*spoilt, str(error)]


def _outlook(run: Run) -> Iterator[str]:
    """What the policy predicted, if it does."""
    rows, outlook = predictions(run.result), Outlook.of(run.events())
    if rows:
        yield section("What the policy predicted", definitions(rows, "tiles"))
    if len(outlook.t) > 1:
        yield section(
            "The prediction over the fold",
            drawing(outlook_figure(run, outlook), "predictions of the policy over time"),
            note="Bands: one sigma, in which 68 % of the outcomes should lie. The dotted line is "
            "the displacement that the camera measured in the end.",
        )


def _film(run: Run) -> str:
    """The run's film, if there is one."""
    first = next((note.stamp for note in run.frame_index() if note.film == 0), None)
    return "" if first is None or not (run.folder / FILM).is_file() else film(FILM, first)


def _files(run: Run) -> list[tuple[Link, str]]:
    """Files of the run that are worth opening, with what they hold."""
    return [(Link(name, name), what) for name, what in FILES if (run.folder / name).is_file()]


def _pictures(run: Run, outlines: Sequence[Silhouette]) -> Iterator[str]:
    pictures = key_pictures(run, outlines)
    yield section(
        "What the camera saw",
        photographs([(picture.jpeg, picture.caption, picture.whole) for picture in pictures]),
        note="Orange: the lifted strip as it was found, and the outline of the strip once the "
        "layers touch. Blue: the desk contact. White: the fold's tip.",
    )
    if run.ticks.t.size == 0:
        return
    yield section(
        "The strip and the path",
        drawing(
            strip_figure(run, outlines), "side view of the strip over time and the gripper's path"
        ),
        note="Coloured by time: the lifted strip in the images; filled: the strip while it is laid "
        "and when it lies, as it fills the image. The strong line is the gripper's "
        "measured path, the dotted one the commanded; ticks under the desk mark the contacts.",
    )
    yield section(
        "Over time",
        _film(run),
        drawing(signals_figure(run), "states and signals over time"),
    )
    yield section("Timing", drawing(timing_figure(run), "histograms of the timing"))
