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


@pytest.mark.parametrize("stray", [0.0015, 0.002, 0.003])
def test_a_stray_piece_before_the_strip_is_no_contact(stray: float) -> None:
    """As the clamp of images that are shifted by 2 mm: it read 1 mm, and the fold failed by 54."""
    assert search((0.0, stray), (0.008, 0.3)).x == pytest.approx(0.3, abs=2 * SAMPLE_SPACING)


def test_a_fold_that_hangs_low_beyond_the_contact_is_not_searched() -> None:
    assert search((0.0, 0.3), (0.32, 0.34)).x == pytest.approx(0.3, abs=2 * SAMPLE_SPACING)


def test_a_hump_over_a_crease_is_no_contact() -> None:
    """As of a crease in half of a strip: it read 254 mm where the strip left the desk at 431."""
    assert search((0.0, 0.254), (0.262, 0.431)).x == pytest.approx(0.431, abs=2 * SAMPLE_SPACING)
    lying = search((0.0, 0.254), (0.262, 1.0))
    assert (lying.x, lying.confidence) == (SAMPLE_SPACING * (COUNT - 1), 1.0)


def test_strip_that_lies_less_than_its_length_beyond_a_hump_is_of_the_fold() -> None:
    assert search((0.0, 0.254), (0.262, 0.311)).x == pytest.approx(0.254, abs=2 * SAMPLE_SPACING)
    assert search((0.0, 0.254), (0.262, 0.313)).x == pytest.approx(0.313, abs=2 * SAMPLE_SPACING)


def test_of_two_humps_the_last_lying_piece_counts() -> None:
    found = search((0.0, 0.1), (0.11, 0.13), (0.14, 0.25), (0.26, 0.28))
    assert found.x == pytest.approx(0.25, abs=2 * SAMPLE_SPACING)
