"""View of a calibration in Rerun: image with measurements, coverage, next request."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from calibration.wizard.news import News, TouchNews, ViewNews
from cell.report.viz.recording import jpeg, watched_recording
from cell.report.viz.saving import send_blueprint

WIZARD_RECORDING = "wizard.rrd"
CORNERS_RGBA = 0x6ED25AFF
FITTED_RGBA = 0x6ED25AFF
HELD_OUT_RGBA = 0x2882FFFF
WANTED_RGBA = 0xFFAA32FF


@contextmanager
def wizard_screen(
    folder: Path, *, live: bool = False, viewer: Callable[[str], None] | None = None
) -> Iterator["WizardScreen"]:
    """Open a screen that draws into wizard.rrd of `folder`, which must exist by the first drawing.

    `live` serves it on loopback too, and `viewer` opens a viewer there.
    """
    path = folder / WIZARD_RECORDING
    with watched_recording("cell-wizard", path, live=live, viewer=viewer) as recording:
        send_blueprint(recording, _blueprint())
        yield WizardScreen(recording)


class WizardScreen:
    """Draws the steps of a calibration wizard in Rerun; the only user of its entity paths."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._to = recording
        self._count = 0

    def __call__(self, news: News) -> None:
        """Draw one step of the wizard."""
        self._count += 1
        self._to.set_time("step", sequence=self._count)
        if news.frame is not None:
            self._to.log("camera/image", jpeg(news.frame.image))
        if isinstance(news, ViewNews):
            self._draw_views(news)
        else:
            self._draw_touches(news)

    def verdict(self, words: str) -> None:
        """Log the wizard's verdict."""
        self._to.log("wizard/log", rr.TextLog(words))
        self._to.log("wizard/words", rr.TextDocument(words))

    def _draw_views(self, news: ViewNews) -> None:
        """Draw the request of a board's view, its coverage, and the result of the last view."""
        wanted = "nothing more" if news.wanted is None else str(news.wanted)
        rows = [f"{'x' if gate.passed else ' '} {gate}" for gate in news.gates]
        self._log_request(wanted, news.why, rows)
        shares = np.array([gate.share for gate in news.gates])
        self._to.log("wizard/coverage", rr.BarChart(shares))
        if news.sketch is not None:
            corners = news.sketch.wanted
            outlines = [] if corners is None else [np.vstack([corners, corners[:1]])]
            labels = ["wanted"] * len(outlines)
            strips = rr.LineStrips2D(outlines, colors=WANTED_RGBA, radii=3, labels=labels)
            self._to.log("camera/image/wanted", strips)
        if news.result is None:
            return
        if news.result.refused is not None:
            words = f"image {news.result.number}: {news.result.refused}"
            self._to.log("wizard/log", rr.TextLog(words))
        if news.result.seen is not None:
            points = rr.Points2D(news.result.seen.image, colors=CORNERS_RGBA, radii=3)
            self._to.log("camera/image/corners", points)

    def _draw_touches(self, news: TouchNews) -> None:
        wanted = "nothing more" if news.wanted is None else news.request
        done = f"{len({point.number for point in news.touches})} of {len(news.plan)} points"
        self._log_request(wanted, news.why, [str(news.stage), done])
        if news.touches:
            pixels = np.array([point.pixel for point in news.touches])
            shades = [HELD_OUT_RGBA if point.held_out else FITTED_RGBA for point in news.touches]
            colours = np.array(shades, dtype=np.uint32)
            names = [str(point.number) for point in news.touches]
            marks = rr.Points2D(pixels, colors=colours, labels=names, radii=5)
            self._to.log("camera/image/touched", marks)
        if news.result is not None and news.result.refused is not None:
            words = f"point {news.result.number}: {news.result.refused}"
            self._to.log("wizard/log", rr.TextLog(words))

    def _log_request(self, wanted: str, why: str, rows: list[str]) -> None:
        words = "\n".join([f"next: {wanted}", f"why: {why}", "", *rows])
        self._to.log("wizard/words", rr.TextDocument(words))


def _blueprint() -> Any:
    right = rrb.Vertical(
        rrb.TextDocumentView(origin="/wizard/words", name="what is wanted"),
        rrb.BarChartView(origin="/wizard/coverage", name="covered"),
        rrb.TextLogView(origin="/wizard/log", name="refused, and why"),
    )
    camera = rrb.Spatial2DView(origin="/camera/image", name="camera")
    return rrb.Blueprint(
        rrb.Horizontal(camera, right, column_shares=[3, 2]),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
