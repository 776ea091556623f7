"""A strip without a file: what the operator states of it, and what is assumed."""

import pytest

from cell.base.config.unmeasured_strip import (
    MARK,
    THICKNESS_RANGE,
    unmeasured_name,
    unmeasured_strip,
)
from tests.support.refusals import refusal


def known(length: float, thickness: float | None) -> str:
    return unmeasured_name(length, thickness).removeprefix(MARK)


def test_thickness_is_a_range_until_it_is_stated() -> None:
    assert unmeasured_strip(known(0.6, None)).spread["thickness"] == THICKNESS_RANGE
    stated = unmeasured_strip(known(0.55, 0.0005))
    assert (stated.length, stated.thickness) == (0.55, 0.0005)
    assert "thickness" not in stated.spread
    sources = {entry.key: entry.source for entry in stated.provenance}
    assert sources["thickness"] == "measured"


@pytest.mark.parametrize(
    ("text", "option"),
    [("long", "length"), ("0.6:thin", "thickness"), ("0.6:-1", "thickness")],
)
def test_what_is_no_length_or_thickness_is_refused_in_a_line(
    text: str, option: str
) -> None:
    with refusal(option) as refused:
        unmeasured_strip(text)
    assert "\n" not in str(refused.value)
