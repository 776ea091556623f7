"""What the operator reads in the terminal: wanted and why, covered or not, and the verdict."""

import io
from dataclasses import replace

import numpy as np
from rich.console import Console

from calibration.wizard.coverage import Gate, Sketch
from calibration.wizard.latency import NOT_MEASURED, LatencyVerdict
from calibration.wizard.news import News, PlannedPoint, Result, Row
from calibration.wizard.touch_verdict import map_lines, touch_verdict
from calibration.wizard.touches import Touch, TouchSettings, held_out, touch_plan
from calibration.wizard.verdict import Level
from cell.calibrating.keyboard import KEY_HELP
from cell.calibrating.wizard_panel import SKETCH, WizardPanel, sketch_text, verdict_text
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import CameraSettings
from tests.support.board_sessions import LENS

SETTINGS = TouchSettings()
PLAN = touch_plan(SETTINGS)
LATE = LatencyVerdict(0.031, 0.0004, 0.1, 40)
GATES = (
    Gate("x", 0.2, 0.5, "", "show it far left and far right"),
    Gate("its top away", 2.0, 2.0, "views", "lean its top away"),
)


def _terminal(news: News) -> str:
    console = Console(file=io.StringIO(), width=100, record=True, force_terminal=True)
    console.print(WizardPanel(console).draw(news))
    return console.export_text()


WANTED = "show the board high and left, 40 % of the image wide, top away by 16 deg"


def _views(why: str) -> News:
    return News("the lens, from a board", WANTED, why, coverage=GATES)


def _touches(count: int) -> tuple[Touch, ...]:
    optics = Optics.of(CameraSettings(principal=(5.5, -4.5)))
    places = [np.array([pose.x, pose.z]) for pose in PLAN[:count]]
    return tuple(
        Touch(k, at, optics.plane(at), held_out(k, SETTINGS)) for k, at in enumerate(places)
    )


def test_board_panel_states_request_reason_and_missing_coverage() -> None:
    shown = _terminal(_views(f"still missing: {GATES[0]}"))
    assert "show the board high and left, 40 % of the image wide, top away by 16 deg" in shown
    assert "why   still missing: x: 0.20 of 0.50" in shown
    assert "0.20 of 0.50" in shown.split("why")[1].splitlines()[2]
    assert "show it far left and far right" in shown
    assert "lean its top away" not in shown


def test_panel_draws_the_wanted_board_and_the_one_that_is_seen() -> None:
    wanted = np.array([(0.0, 0), (600, 0), (600, 719), (0, 719)])
    text = sketch_text(Sketch((1280, 720), wanted, wanted + np.array([660, 0])))
    columns, rows = SKETCH
    assert [len(line) for line in text.plain.splitlines()[:rows]] == [columns] * rows
    for style, left in (("bold yellow", True), ("green", False)):
        places = [span.start % (columns + 1) for span in text.spans if str(span.style) == style]
        assert len(places) > 2 * rows
        assert all((place < columns // 2) is left for place in places)


def test_question_that_says_what_is_next_is_not_said_twice() -> None:
    news = _views("still missing: x")
    console = Console(file=io.StringIO(), width=80, record=True, force_terminal=True)
    panel = WizardPanel(console)
    panel.ask(f"{news.request}  [{KEY_HELP}]")
    console.print(panel.draw(news))
    shown = console.export_text()
    assert shown.count("show the board high and left") == 1
    assert shown.count("why   still missing: x") == 1


def test_touch_panel_maps_the_plane() -> None:
    states = ["x", "o", "h", "o", "o", "o", "h", "o", ">", *15 * "."]
    plan = tuple(PlannedPoint(p.x, p.z, state) for p, state in zip(PLAN, states, strict=True))
    shown = _terminal(News("the map", "the arm goes to x 368, z 110 mm", "point 8", plan=plan))
    rows = [line for line in shown.splitlines() if "z " in line and " mm " in line]
    assert rows[-2].split("mm")[-1].replace("│", "").split() == [".", ".", ".", ">", "o", "h"]
    assert rows[-1].split("mm")[-1].replace("│", "").split() == ["x", "o", "h", "o", "o", "o"]
    assert "the arm goes to x 368, z 110 mm" in shown


def test_without_a_terminal_each_answer_is_a_line() -> None:
    out = io.StringIO()
    panel = WizardPanel(Console(file=out, width=60))
    refused = Result(Row(number=7, refused="0 corners of the board are seen; light it"))
    waits, taken = Result(Row(number=8)), Result(Row(number=3), taken=True)
    with panel:
        for answer in (
            refused.text("image", "taken"),
            waits.text("image", "taken"),
            taken.text("point", "touched again at x 368, z 15 mm"),
        ):
            panel(News("the lens", "", "", answer=answer))
    assert out.getvalue().splitlines() == [
        "image 7: 0 corners of the board are seen; light it",
        "point 3: touched again at x 368, z 15 mm",
    ]


def test_verdict_is_coloured_and_says_what_to_do() -> None:
    good = touch_verdict(_touches(24), LENS, SETTINGS)
    lines = map_lines(good, LATE, 0.1)
    assert [line.level for line in lines] == 5 * [Level.GOOD]
    assert "this moves the displacement by 0.00 mm (rms)" in lines[2].text
    assert "images show the world +31.0 ms before their stamps" in lines[3].text
    assert "at 0.10 m/s this would be 3.1 mm" in lines[3].text
    assert lines[-1].text == "good: this calibration may be used"
    bad = touch_verdict(_touches(6), LENS, SETTINGS)
    assert not bad.passed
    refused = map_lines(bad, NOT_MEASURED, 0.1)
    assert refused[-1].text.startswith("refused: mend what is said above")
    assert {str(span.style) for span in verdict_text(refused).spans} == {"bold red"}


SMALL = 80, 24  # columns, lines of the smallest terminal that anybody uses
FULL = tuple(
    Gate(name, 0.0, 2.0, "views", "lean its right edge nearer to the camera than that")
    for name in ("x", "y", "size", "skew", "its top away", "its top nearer",
                 "its right edge away", "its right edge nearer", "image", "views")
)  # fmt: skip


def test_small_terminal_keeps_the_question_and_the_panel_is_never_higher() -> None:
    """A live view that is higher than its terminal leaves old lines behind."""
    why = "0 corners of the board are seen, 16 are needed; light it evenly and hold it still"
    columns, lines = SMALL
    console = Console(
        file=io.StringIO(), width=columns, height=lines, record=True, force_terminal=True
    )
    panel, news = WizardPanel(console), replace(_views("still missing: x"), coverage=FULL)
    for k in range(8):
        panel(replace(news, answer=f"image {k}: {k} {why}"))
        panel.ask(f"{WANTED}  [{KEY_HELP}]")
    shown = console.render_lines(panel.draw(news), pad=False)
    assert len(shown) < lines
    screen = "\n".join("".join(part.text for part in line) for line in shown)
    assert "Enter go on | s leave out" in screen
    assert "its right edge nearer" in screen
