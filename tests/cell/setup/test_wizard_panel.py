"""What the operator reads in the terminal: wanted and why, covered or not, and the
verdict.
"""

import io

from rich.console import Console

from calibration.wizard.coverage import Gate
from calibration.wizard.progress import Progress, SessionRow
from cell.setup.wizard_panel import WizardPanel

GATES = (
    Gate("x", 0.2, 0.5, "show it far left and far right"),
    Gate("its top away", 2.0, 2.0, "lean its top away", "views"),
)


def _terminal(progress: Progress) -> str:
    console = Console(file=io.StringIO(), width=100, record=True, force_terminal=True)
    console.print(WizardPanel(console).draw(progress))
    return console.export_text()


WANTED = "show the board high and left, 40 % of the image wide, top away by 16 deg"


def test_board_panel_states_request_reason_and_missing_coverage() -> None:
    why = f"still missing: {GATES[0]}"
    shown = _terminal(Progress("the lens, from a board", WANTED, why, coverage=GATES))
    assert (
        "show the board high and left, 40 % of the image wide, top away by 16 deg"
        in shown
    )
    assert "why   still missing: x: 0.20 of 0.50" in shown
    assert "0.20 of 0.50" in shown.split("why")[1].splitlines()[2]
    assert "show it far left and far right" in shown
    assert "lean its top away" not in shown


def test_without_a_terminal_each_answer_is_a_line() -> None:
    out = io.StringIO()
    panel = WizardPanel(Console(file=out, width=60))
    refused = SessionRow(number=7, refused="0 corners of the board are seen; light it")
    taken = SessionRow(number=3, pose=(0.3681, 0.0149, 1.57), again=True, taken=True)
    with panel:
        for row in (
            refused,
            SessionRow(number=8),
            taken,
            SessionRow(number=3, dropped=True),
        ):
            panel(Progress("the lens", "", "", result=row))
    assert out.getvalue().splitlines() == [
        "image 7: 0 corners of the board are seen; light it",
        "point 3: touched again at x 368, z 15 mm",
    ]
