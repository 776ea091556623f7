"""One convention of units: SI, or the unit that stands behind a number or at the end of
a name.
"""

import re
from collections.abc import Iterator

import pytest
import typer

from cell.base.config.length import metres
from cell.interface.cli.app import app
from drivers.strip.describe import load_strip
from tests.support.commands import run

UNIT = re.compile(r"\[(m|mm|s|deg|rad|kg/m\^2|N|Hz)\]")


def options(command: object, path: str = "cell") -> Iterator[tuple[str, object]]:
    for parameter in command.params:
        yield path, parameter
    for name, inner in getattr(command, "commands", {}).items():
        yield from options(inner, f"{path} {name}")


def test_every_option_that_takes_a_length_says_in_which_unit_a_bare_number_is() -> None:
    found = {
        (path, parameter.opts[0]): parameter.help or ""
        for path, parameter in options(typer.main.get_command(app))
        if parameter.metavar == "LENGTH"
    }
    assert len(found) >= 9
    assert not {key: text for key, text in found.items() if not UNIT.search(text)}


@pytest.mark.parametrize(
    ("bare", "text"),
    [
        ("m", "0.6"),
        ("m", "600mm"),
        ("m", "60 cm"),
        ("m", "0.6m"),
        ("m", "6e-1"),
        ("mm", "600"),
    ],
)
def test_length_may_carry_its_unit_and_else_has_that_of_the_option(
    bare: str, text: str
) -> None:
    assert metres("--length", text, bare=bare) == pytest.approx(0.6)


def test_strip_is_made_from_lengths_as_a_ruler_shows_them(configs, monkeypatch) -> None:
    monkeypatch.chdir(configs.parent)
    run(monkeypatch, "strips new linen --length 600mm --width 5cm --thickness 0.4mm")
    made = load_strip(configs / "strips/linen.yaml")
    assert (made.length, made.width, made.thickness) == (0.6, 0.05, 0.0004)
