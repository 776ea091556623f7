"""What the operator reads in the terminal: wanted and why, covered or not, and the verdict."""

import io
from dataclasses import replace

import numpy as np
from rich.console import Console

from calibration.board_view import BoardLook
from calibration.board_views import ToldView
from calibration.touch_settings import TouchSettings
from calibration.touched_points import ToldTouch, held_out, touch_plan
from calibration.wizard.coverage import Gate
from calibration.wizard.latency import LatencyVerdict
from calibration.wizard.news import Stage, TouchNews, ViewNews
from calibration.wizard.touch_fit import Touched
from calibration.wizard.touch_verdict import Grade, touch_verdict
from calibration.wizard.wanted_view import WantedView
from calibration.wizard.words import Level, touch_lines
from cell.operations.wizard_panel import WizardPanel, verdict_text
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import CameraSettings
from tests.support.board_sessions import LENS

SETTINGS = TouchSettings()
PLAN = touch_plan(SETTINGS)
LATE = LatencyVerdict(0.031, 0.0004, 0.1, 40, ())
GATES = (
    Gate("x", 0.2, 0.5, "", "show it far left and far right"),
    Gate("its top away", 2.0, 2.0, "views", "lean its top away"),
)


def _terminal(news: ViewNews | TouchNews) -> str:
    console = Console(file=io.StringIO(), width=100, record=True, force_terminal=True)
    console.print(WizardPanel(console).drawn(news))
    return console.export_text()


def _touches(count: int) -> tuple[Touched, ...]:
    optics = Optics.of(CameraSettings(principal=(5.5, -4.5)))
    places = [np.array([pose.x, pose.z]) for pose in PLAN[:count]]
    return tuple(
        Touched(k, at, optics.plane(at), held_out(k, SETTINGS)) for k, at in enumerate(places)
    )


def test_board_panel_says_what_is_wanted_why_and_what_is_missing() -> None:
    wanted = WantedView(0.16, 0.27, 0.4, 0.28, 0.28)
    shown = _terminal(ViewNews(wanted, "still missing: x", GATES))
    assert "show the board high and left, 40 % of the image wide, top away by 16 deg" in shown
    assert "why   still missing: x" in shown
    assert "0.20 of 0.50" in shown
    assert "show it far left and far right" in shown
    assert "lean its top away" not in shown


def test_touch_panel_maps_the_plane() -> None:
    touches = (*_touches(8), replace(_touches(1)[0], again=True))
    shown = _terminal(TouchNews(Stage.TOUCH, PLAN, touches, PLAN[8], "point 8: 8 of 24"))
    rows = [line for line in shown.splitlines() if "z " in line and " mm " in line]
    assert rows[-2].split("mm")[-1].replace("│", "").split() == [".", ".", ".", ">", "o", "h"]
    assert rows[-1].split("mm")[-1].replace("│", "").split() == ["x", "o", "h", "o", "o", "o"]
    assert "the arm goes to x 368, z 110 mm" in shown


def test_without_a_terminal_each_answer_is_a_line() -> None:
    out = io.StringIO()
    panel = WizardPanel(Console(file=out, width=60))
    look = BoardLook(None, 0, 0.0)
    told = ToldView(7, look, None, "0 corners of the board are seen, 16 are needed; light it")
    with panel:
        panel(ViewNews(None, "", GATES, None, told))
        panel(ViewNews(None, "", GATES, None, ToldView(8, look, None, None, waits=True)))
        number = ToldTouch(3, None, _touches(4)[3], None)
        panel(TouchNews(Stage.AGAIN, PLAN, (), None, "", None, PLAN[3], number))
    assert out.getvalue().splitlines() == [
        "image 7: 0 corners of the board are seen, 16 are needed; light it",
        "point 3: touched again at x 368, z 15 mm",
    ]


def test_verdict_is_coloured_and_says_what_to_do() -> None:
    good = touch_verdict(_touches(24), LENS, SETTINGS)
    lines = touch_lines(good, LATE, 0.1)
    assert [line.level for line in lines] == 5 * [Level.GOOD]
    assert "this moves the displacement by 0.00 mm (rms)" in lines[2].text
    assert "images show the world +31.0 ms before their stamps" in lines[3].text
    assert "at 0.10 m/s this would be 3.1 mm" in lines[3].text
    assert lines[-1].text == "good: this calibration may be used"
    bad = touch_verdict(_touches(6), LENS, SETTINGS)
    assert bad.grade is Grade.REFUSED
    refused = touch_lines(bad, None, 0.1)
    assert refused[-1].text.startswith("refused: mend what is said above")
    assert {str(span.style) for span in verdict_text(refused).spans} == {"bold red"}
