"""Tables on terminals of any width: no name and no number is broken."""

import re

import pytest

from cell.interface.cli.output import print_table, printable

NAMES = [
    "20261121T041512Z-jacket-knit-fold-7f3a",
    "20261121T041530Z-trouser-twill-fold-11c2",
]
COLUMNS = ("run", "strip", "policy", "outcome", "d mm", "s", "MB")
ROWS = [
    (name, "jacket-knit", "triangular", "layer_touch", "-3.9", "21.4", "2.8")
    for name in NAMES
]


@pytest.mark.parametrize("width", [1, 20, 40, 80, 100, 200])
def test_every_cell_stands_whole_on_a_line(monkeypatch, capsys, width) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    print_table(COLUMNS, ROWS, text=4)
    shown = capsys.readouterr().out
    for row in ROWS:
        for cell in row:
            assert re.search(rf"(?<!\S){re.escape(cell)}(?![^\s,])", shown)
    if width > 40:
        assert max(map(len, shown.splitlines())) <= max(width, 45)


def test_what_a_file_says_moves_no_cursor_and_is_no_markup(monkeypatch, capsys) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    print_table(("run", "outcome"), [("a", "[/red]\x1b[2J")], text=2)
    assert "[/red]\\x1b[2J" in capsys.readouterr().out
    assert printable("Grüße, \udcff") == "Grüße, \\udcff"
