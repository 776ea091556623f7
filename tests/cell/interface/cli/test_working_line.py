"""One living line says phase, share and time left; without a terminal, plain lines."""

import sys

from cell.interface.cli import output
from cell.interface.cli.output import working
from tests.support.plain_cell import ARM


class Clock:
    """Clock whose time a test sets."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now


def test_without_a_terminal_lines_come_as_often_as_they_should_and_are_plain(
    monkeypatch, capsys
) -> None:
    clock = Clock()
    monkeypatch.setattr(output, "time", clock)
    with working("opening") as show:
        for k in range(30):
            clock.now = float(k)
            show("folding", k / 30)
    said = capsys.readouterr().err
    assert said == "cell: folding  33 %, 0:20 left\ncell: folding  67 %, 0:10 left\n"


def test_on_a_terminal_the_line_is_shown_at_once(monkeypatch) -> None:
    shown: list[str] = []

    class Status:
        def __enter__(self) -> "Status":
            return self

        def __exit__(self, *_: object) -> None: ...

        def update(self, text: str) -> None:
            shown.append(text)

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr("rich.console.Console.status", lambda *_: Status())
    with working("opening") as show:
        show("folding", 0.0)
    assert shown == ["folding  0 %"]


def test_share_of_a_fold_is_how_far_the_gripper_has_come(monkeypatch) -> None:
    from dataclasses import replace

    from cell.interface.cli.fold import TICKS_SHOWN, _ProgressLine
    from cell.orchestrator.snapshot import Snapshot
    from cell.orchestrator.states import State
    from cell.orchestrator.vision import View
    from drivers.base.types import HandState, Pose

    told: list[tuple[str, float]] = []
    line = _ProgressLine(lambda *said: told.append(said), "denim")
    hand = HandState(0.0, 0.0, "made", 0.0, True, False)
    for x in (0.6, 0.3, 0.0):
        arm = replace(ARM, pose=Pose(x, 0.1, 0.0))
        snapshot = Snapshot(0.0, State.FOLD, 0.0, arm, hand, View(None, False, 0, None))
        for _ in range(TICKS_SHOWN):
            line.handle_tick(snapshot)
    assert [share for _, share in told] == [0.0, 0.5, 1.0]
    assert told[0][0].startswith("denim  FOLD")
