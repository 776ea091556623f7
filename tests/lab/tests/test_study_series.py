"""The study of folds in a row: its wrong cells exist, and it says what the cell
noticed.
"""

import pytest

from drivers.strip.effects import check_effects, registry
from tests.lab.studies.catalogue import series


@pytest.mark.parametrize("cell", series.WRONG_CELLS)
def test_every_wrong_cell_is_a_plant_of_the_twin(cell: str) -> None:
    assert series.WRONG_CELLS[cell] or series.THICKER[cell]
    for name, values in series.WRONG_CELLS[cell].items():
        check_effects({name: values}, origin=cell, of=[registry()[name].of])
