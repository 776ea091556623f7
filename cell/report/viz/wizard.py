"""Recording of a calibration for Rerun: image with measurements, coverage, next
request.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from calibration.wizard.progress import COLOURS_BGR, Progress
from cell.report.viz.recording import jpeg, open_recording

WIZARD_RECORDING = "wizard.rrd"
WANTED_RGBA = 0xFFAA32FF


@contextmanager
def wizard_screen(folder: Path, *, live: bool = False) -> Iterator["WizardScreen"]:
    """Draw a wizard's steps into wizard.rrd of `folder`; if `live`, a viewer opens on
    it too.
    """
    path = folder / WIZARD_RECORDING
    with open_recording("cell-wizard", path, _blueprint(), live=live) as recording:
        yield WizardScreen(recording)


class WizardScreen:
    """Writer of a calibration wizard's steps into a Rerun recording: image, coverage,
    request.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._to = recording
        self._count = 0

    def __call__(self, step: Progress) -> None:
        """Draw one step of the wizard: the request, the image with marks, and the
        coverage.
        """
        self._count += 1
        self._to.set_time("step", sequence=self._count)
        if step.frame is not None:
            self._to.log("camera/image", jpeg(step.frame.image))
        gates = [f"{'x' if gate.passed else ' '} {gate}" for gate in step.coverage]
        words = "\n".join(
            [f"next: {step.request}", f"why: {step.why}", "", step.title, *gates]
        )
        self._to.log("wizard/words", rr.TextDocument(words))
        if step.coverage:
            shares = np.array([gate.share for gate in step.coverage])
            self._to.log("wizard/coverage", rr.BarChart(shares))
        if step.sketch is not None:
            corners = step.sketch.wanted
            outlines = [] if corners is None else [np.vstack([corners, corners[:1]])]
            labels = ["wanted"] * len(outlines)
            strips = rr.LineStrips2D(
                outlines, colors=WANTED_RGBA, radii=3, labels=labels
            )
            self._to.log("camera/image/wanted", strips)
        if step.marks:
            pixels = np.array([mark.pixel for mark in step.marks])
            colours = np.array(
                [COLOURS_BGR[mark.kind][::-1] for mark in step.marks], np.uint8
            )
            names = [mark.label for mark in step.marks if mark.label]
            points = rr.Points2D(pixels, colors=colours, labels=names or None, radii=4)
            self._to.log("camera/image/marks", points)
        if step.result is not None and step.result.refused is not None:
            self._to.log("wizard/log", rr.TextLog(step.result.answer))


def _blueprint() -> Any:
    """Layout of Rerun's viewer for a calibration: camera, and what is wanted, covered,
    refused.
    """
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
