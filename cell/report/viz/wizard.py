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
from cell.report.html import jpeg
from cell.report.viz import saving
from cell.report.viz.opening import open_recording
from drivers.base.types import Image

WIZARD_RECORDING = "wizard.rrd"
WANTED_RGBA = 0xFFAA32FF
STEPS_A_SECOND = 1.0  # of a recording that is played


@contextmanager
def wizard_screen(folder: Path, *, live: bool = False) -> Iterator["WizardScreen"]:
    """Draw a wizard's steps into wizard.rrd of `folder`; if `live`, a viewer opens on
    it too.
    """
    path = folder / WIZARD_RECORDING
    views = _views()
    layout = saving.blueprint(views, timeline="step", live=live, fps=STEPS_A_SECOND)
    with open_recording("cell-wizard", path, layout, live=live) as recording:
        yield WizardScreen(recording)


class WizardScreen:
    """Writer of a calibration wizard's steps into a Rerun recording: image, coverage,
    request.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._to = recording
        self._count = 0
        self._has_image = False

    def __call__(self, step: Progress) -> None:
        """Draw one step of the wizard: the request, the image with marks, and the
        coverage.
        """
        result = step.result
        self._count += 1
        self._to.set_time("step", sequence=self._count)
        if step.frame is not None:
            self._draw_image(step.frame.image)
        self._to.log("wizard/words", saving.document(_words(step)))
        self._draw_coverage(step)
        self._draw_marks(step)
        if result is not None and result.refused is not None:
            self._to.log("wizard/log", rr.TextLog(result.answer))

    def _draw_image(self, image: Image) -> None:
        """Draw an image; the first one stands from the first step on."""
        to = self._to
        content = jpeg(image, image.shape[1])
        picture = rr.EncodedImage(contents=content, media_type="image/jpeg")
        to.log("camera/image", picture)
        if not self._has_image:
            self._has_image = True
            to.set_time("step", sequence=1)
            to.log("camera/image", picture)
            to.set_time("step", sequence=self._count)

    def _draw_coverage(self, step: Progress) -> None:
        """Draw how much of each of the wizard's gates is reached."""
        if not step.coverage:
            return
        shares = np.array([gate.share for gate in step.coverage])
        self._to.log("wizard/coverage", rr.BarChart(shares))

    def _draw_marks(self, step: Progress) -> None:
        """Draw what was found in the image, and what is wanted; clear what is not any
        more.
        """
        marks = step.marks
        log = self._to.log
        corners = None if step.sketch is None else step.sketch.wanted
        if corners is None:
            log("camera/image/wanted", rr.Clear(recursive=False))
        else:
            outline = np.vstack([corners, corners[:1]])
            line = rr.LineStrips2D(
                [outline], colors=WANTED_RGBA, radii=3, labels=["wanted"]
            )
            log("camera/image/wanted", line)
        if not marks:
            log("camera/image/marks", rr.Clear(recursive=False))
            return
        pixels = np.array([mark.pixel for mark in marks])
        colours = [COLOURS_BGR[mark.kind][::-1] for mark in marks]
        names = [mark.label for mark in marks if mark.label]
        points = rr.Points2D(pixels, colors=colours, labels=names or None, radii=4)
        log("camera/image/marks", points)


def _words(step: Progress) -> str:
    """Text in Markdown on what is wanted, why, and what is reached."""
    gates = [f"- {'[x]' if gate.passed else '[ ]'} {gate}" for gate in step.coverage]
    lines = [f"## {step.request}", step.why, f"**{step.title}**", "\n".join(gates)]
    return "\n\n".join(filter(None, lines))


def _views() -> Any:
    """Views of a calibration: camera, and what is wanted, covered, refused."""
    return saving.arrange(
        rrb.Spatial2DView(origin="/camera/image", name="camera"),
        None,
        rrb.TextDocumentView(origin="/wizard/words", name="what is wanted"),
        (
            rrb.BarChartView(origin="/wizard/coverage", name="covered"),
            rrb.TextLogView(origin="/wizard/log", name="refused, and why"),
        ),
        (1, 1),
    )
