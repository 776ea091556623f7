"""HTML page of a run."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cell.record.columns import FARTHEST_HAND
from cell.record.events import Outlook
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
from cell.record.run import Run, read_broken_run
from cell.record.truth import read_truth
from cell.report.facts import advice, checks, left_files, listed_events, measures, settings_rows
from cell.report.figures import (
    outlook_figure,
    predictions,
    signals_figure,
    strip_figure,
)
from cell.report.kit import Link, page
from cell.report.overlay import close_ups, key_pictures, poster, silhouettes
from cell.report.verdict import verdict_of
from drivers.errors import ConfigurationError
from drivers.files import write_file

FILES = (
    (RECORDING, "the fold in Rerun: rerun run.rrd"),
    (FILM, "the film of the camera, in step with frames/index.jsonl"),
    (OVERLAY, "the film with what was read in it"),
    (CALIBRATION, "the camera's calibration; cell report calibration.yaml draws it"),
    (TICKS, "gripper, contact and force over time"),
    (PROFILE, "the strip in every image"),
    (RUN, "settings and versions"),
)
LARGEST_FILM = 8_000_000  # bytes that a page carries


def write_report(folder: Path) -> Path:
    """Write report.html into the run's folder and return its path.

    A run that died or is damaged is reported as far as it can be read. Raises ConfigurationError
    for a folder without a readable run.yaml, or one that cannot be written.
    """
    return write_page(read_broken_run(folder))


def write_page(run: Run) -> Path:
    """Write report.html of the `run` into its folder and return its path, as `write_report`."""
    path = run.folder / REPORT
    write_file(path, report(run))
    return path


def report(run: Run) -> str:
    """HTML page of `run`."""
    policy = f", policy {run.header.policy}" if run.header.policy else ""
    under_way = is_under_way(run.folder)
    truth, spoilt = truth_of(run)
    said = verdict_of(run, truth, under_way)
    died = run.result is None and not under_way and not said.spoilt
    return page(
        "report/templates/run.html",
        f"{run.header.strip} · {run.name}",
        kicker=f"Fold of {run.header.strip}{policy}",
        name=run.name,
        said=said,
        close_ups=close_ups(run) if said.figure else (),
        spoilt=spoilt,
        advice=advice(run) if died else [],
        left_files=left_files(run) if died else [],
        measures=measures(run),
        predictions=predictions(run.result),
        film=film_of(run),
        checks=checks(run),
        events=listed_events(run),
        files=_files(run),
        facts=settings_rows(run),
        **_figures(run),
    )


def _figures(run: Run) -> dict[str, Any]:
    """Pictures and figures (SVG) of the run; empty where the record has nothing to draw."""
    outlines, outlook, has_ticks = silhouettes(run), Outlook.of(run.events()), run.ticks.t.size > 0
    return {
        "pictures": key_pictures(run, outlines),
        "outlook": outlook_figure(run, outlook) if len(outlook.t) > 1 else "",
        "strip": strip_figure(run, outlines) if has_ticks else "",
        "signals": signals_figure(run) if has_ticks else "",
    }


def truth_of(run: Run) -> tuple[Mapping[str, Any] | None, list[str]]:
    """Truth of the run, None where it cannot be read, and lines on broken parts of its folder."""
    spoilt = list(run.problems)
    try:
        return read_truth(run.folder), spoilt
    except ConfigurationError as error:
        return None, [*spoilt, str(error)]


def film_of(run: Run) -> dict[str, Any] | None:
    """Film for a page: `begin`, its first stamp [s], `source`, content or address, and `poster`.

    A page with the content can be mailed; a film of more than LARGEST_FILM stays beside it.
    """
    path = run.folder / FILM
    begin = next((note.stamp for note in run.frame_index() if note.film == 0), None)
    if begin is None or not path.is_file():
        return None
    source = FILM
    if path.stat().st_size <= LARGEST_FILM:
        source = f"data:video/mp4;base64,{base64.b64encode(path.read_bytes()).decode()}"
    return {"begin": begin, "source": source, "poster": poster(run), **_read_in(run)}


def _read_in(run: Run) -> dict[str, Any]:
    """Curves measured in the film: `size` of an image, `curves` of (time [s], flat pixels x, y)."""
    calibration = run.calibration()
    if calibration is None:
        return {"size": (), "curves": ()}
    curves = [
        (round(t, 3), np.rint(calibration.to_image(points[::2])).astype(int).ravel().tolist())
        for t, points in run.profile.curves()
        if np.abs(points).max(initial=0.0) < FARTHEST_HAND
    ]
    return {"size": (calibration.lens.width, calibration.lens.height), "curves": curves}


def _files(run: Run) -> list[tuple[Link, str]]:
    """Files of the run with a description of their content."""
    return [(Link(name, name), what) for name, what in FILES if (run.folder / name).is_file()]
