"""The HTML page of a run."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from cell.record.documents import replace_file
from cell.record.files import REPORT, is_under_way
from cell.record.outlook import Outlook
from cell.record.run import Run
from cell.record.salvage import Salvage
from cell.record.truth import read_truth
from cell.report.facts import advice, checks, facts, listed_events, measures, remains
from cell.report.figures import signals_figure, strip_figure
from cell.report.markup import (
    definitions,
    drawing,
    masthead,
    page,
    photographs,
    section,
    steps,
    table,
    verdict_box,
)
from cell.report.outlook import outlook_figure, predictions
from cell.report.overlay import key_pictures
from cell.report.timing import timing_figure
from cell.report.verdict import verdict_of
from drivers.errors import ConfigurationError


def write_report(folder: Path) -> Path:
    """Write report.html into the run's folder and return its path.

    A run that died or is damaged is reported as far as it can be read. Raises ConfigurationError
    for a folder without a readable run.yaml, or one that cannot be written.
    """
    run = Salvage.of(folder)
    path = folder / REPORT
    try:
        replace_file(path, report(run).encode(errors="backslashreplace"))
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
    return path


def report(run: Run) -> str:
    """The page of `run`."""
    return page(f"{run.header.strip} · {run.name}", list(_parts(run)))


def _parts(run: Run) -> Iterator[str]:
    policy = f", policy {run.header.policy}" if run.header.policy else ""
    kicker = f"Fold of {run.header.strip}{policy}"
    yield masthead(kicker, run.name)
    under_way = is_under_way(run.folder)
    truth, spoilt = _truth(run)
    said = verdict_of(run, truth, under_way)
    yield verdict_box(said.tone, said.headline, said.sentences, said.figure, said.error)
    if spoilt:
        yield section("What could not be read", steps(spoilt))
    if run.died and not said.spoilt:
        yield section("What to do", steps(advice(run)))
        yield section("What is here", definitions(remains(run), "rows"))
    yield section("In numbers", definitions(measures(run), "tiles"))
    yield from _outlook(run)
    yield from _pictures(run)
    yield section("Checks before the motion", table(("check", "result", "why"), checks(run)))
    yield section("What happened", table(("t [s]", "event", ""), listed_events(run)))
    yield section("Made with", definitions(facts(run), "rows"))


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
        yield section("What the policy foretold", definitions(rows, "tiles"))
    if len(outlook.t) > 1:
        yield section(
            "Foretold over the fold",
            drawing(outlook_figure(run, outlook), "predictions of the policy over time"),
            note="Bands: one sigma, in which 68 % of the outcomes should lie. The dotted line is "
            "the displacement that the camera measured in the end.",
        )


def _pictures(run: Run) -> Iterator[str]:
    pictures = [(picture.jpeg, picture.caption) for picture in key_pictures(run)]
    yield section(
        "What the camera saw",
        photographs(pictures),
        note="Orange: the lifted strip as it was found. Blue: the desk contact. "
        "White: the fold's tip.",
    )
    if run.ticks.t.size == 0:
        return
    yield section(
        "The strip and the path",
        drawing(strip_figure(run), "side view of the strip over time and the gripper's path"),
        note="Coloured by time: the lifted strip in the images. The strong line is the gripper's "
        "measured path, the dotted one the commanded; ticks under the desk mark the contacts.",
    )
    yield section(
        "Over time",
        drawing(signals_figure(run), "states and signals over time"),
    )
    yield section("Timing", drawing(timing_figure(run), "histograms of the timing"))
