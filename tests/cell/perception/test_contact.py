"""desk_contact is searched along the line of the strip, whatever lies before it."""

import numpy as np
import pytest

from cell.perception.contact import SAMPLE_SPACING, Contact, SearchLine, find_contact
from cell.perception.kernels import LEVEL_SPAN, ZERO_LEVEL
from drivers.types import Array

COUNT, ROW, FRONT = 2000, 20, 35


def search(*strips: tuple[float, float]) -> Contact:
    """The contact in an image whose row shows strip from ... to ... [m]."""
    levels = np.full((40, COUNT), ZERO_LEVEL, dtype=np.uint8)
    columns = SAMPLE_SPACING * np.arange(COUNT)
    for begin, end in strips:
        levels[ROW - 3 : ROW + 4, (columns >= begin) & (columns < end)] = ZERO_LEVEL + LEVEL_SPAN

    def at(row: int) -> Array:
        return np.column_stack([np.arange(COUNT), np.full(COUNT, row)]).astype(float)

    line = SearchLine(columns, at(ROW), at(FRONT))
    return find_contact(levels, line, np.zeros(2))


def test_contact_is_where_strip_changes_to_desk() -> None:
    found = search((0.0, 0.3))
    assert found.x == pytest.approx(0.3, abs=2 * SAMPLE_SPACING)
    assert found.confidence == 1.0


@pytest.mark.parametrize(
    ("strips", "contact"),
    [
        # a stray piece before the strip, as the clamp of images shifted by 2 mm
        (((0.0, 0.0015), (0.008, 0.3)), 0.3),
        (((0.0, 0.003), (0.008, 0.3)), 0.3),
        # a fold that hangs low beyond the contact
        (((0.0, 0.3), (0.32, 0.34)), 0.3),
        # a hump over a crease, and strip that lies less than its length beyond one
        (((0.0, 0.254), (0.262, 0.431)), 0.431),
        (((0.0, 0.254), (0.262, 0.313)), 0.313),
        (((0.0, 0.254), (0.262, 0.311)), 0.254),
        # of two humps the last lying piece counts
        (((0.0, 0.1), (0.11, 0.13), (0.14, 0.25), (0.26, 0.28)), 0.25),
    ],
)
def test_contact_is_the_end_of_the_last_lying_piece(
    strips: tuple[tuple[float, float], ...], contact: float
) -> None:
    assert search(*strips).x == pytest.approx(contact, abs=2 * SAMPLE_SPACING)


def test_strip_that_lies_to_the_end_of_the_line_is_in_contact_there() -> None:
    lying = search((0.0, 0.254), (0.262, 1.0))
    assert (lying.x, lying.confidence) == (SAMPLE_SPACING * (COUNT - 1), 1.0)
