"""Draws what the operator of the wizards sees, for the runbook, from the twin.

`python -m tests.lab draw-wizard DIR` writes wizard-camera.svg, wizard-homography.svg (the
terminal half way, and at the end) and touches.jpg, views.jpg (the pictures of the sessions).
"""

import io
import shutil
import tempfile
from pathlib import Path

import cv2
from rich.console import Console

from calibration.wizard.news import News
from calibration.wizard.verdict import Line
from cell.calibrating.calibrate import NO_STRIP
from cell.calibrating.keyboard import TwinOperator
from cell.calibrating.wizard import calibrate_homography, calibrate_lens
from cell.calibrating.wizard_panel import WizardPanel, verdict_text
from cell.config.places import CHECKOUT_CONFIGS, Configs
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.open import open_cell
from cell.orchestrator.operator import Unattended

SETTINGS = Configs(CHECKOUT_CONFIGS).cell()
WIDTH = 108  # characters
HALF = 620  # px, height to which the pictures are reduced


class Half:
    """Remembers the panel as it stood after so many `news`."""

    def __init__(self, when: int) -> None:
        self.panel = WizardPanel(Console(file=io.StringIO()))
        self.shown: object = ""
        self._left = when

    def __call__(self, news: News) -> None:
        self.panel(news)
        self._left -= 1
        if self._left == 0:
            self.shown = self.panel.draw(news)


def _devices() -> Devices:
    return open_cell(SETTINGS, NO_STRIP, DeviceSelection(), calibrating=True)


def _draw(half: Half, lines: tuple[Line, ...], title: str, path: Path) -> None:
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(half.shown)
    console.print(verdict_text(lines))
    console.save_svg(str(path), title=title)


def _reduced(session: Path, path: Path) -> None:
    picture = cv2.imread(str(session / "picture.png"))
    size = (round(picture.shape[1] * HALF / picture.shape[0]), HALF)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_JPEG_QUALITY, 82])


def main(out: Path) -> None:
    """Run both wizards and draw."""
    scratch = Path(tempfile.mkdtemp())
    try:
        views, devices = Half(14), _devices()
        operator = Unattended()
        lens = calibrate_lens(SETTINGS, devices, scratch / "camera", operator, views, None)
        _draw(views, lens.lines, "cell calibrate camera", out / "wizard-camera.svg")
        _reduced(scratch / "camera", out / "views.jpg")
        touches, devices = Half(62), _devices()
        if devices.aids is None or lens.verdict.fit is None:
            raise SystemExit("the twin has no hands, or no lens")
        hands, found = TwinOperator(devices.aids, operator), lens.verdict.fit.lens
        made = calibrate_homography(SETTINGS, devices, found, scratch / "map", hands, touches)
        _draw(touches, made.lines, "cell calibrate homography", out / "wizard-homography.svg")
        _reduced(scratch / "map", out / "touches.jpg")
    finally:
        shutil.rmtree(scratch)
