"""The study of folds in a row: its wrong cells exist, and it says what the cell noticed."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cell.config.places import find_configs
from cell.learning.correction import subject_of
from cell.learning.experience import Experience, Memory
from drivers.strip.effects import check_effects, registry
from tests.lab.studies.catalogue import series
from tests.lab.studies.kit.folds import SPECIMEN_NAME

CASES = {(c.values["cell"], c.values["series"]): c.values for c in series.STUDY.cases(0, 12)}


def learned(run: str, displacement: float) -> Experience:
    subject = subject_of("adaptive", None, "unknown", SPECIMEN_NAME)
    return Experience(run, subject.policy, "unknown", SPECIMEN_NAME, "camera", displacement)


def made(change: float, before: int) -> Any:
    """Folds that come out `change` [m] off after so many."""

    def fold(_case: Any, number: int, _place: Path, memory: Path) -> Any:
        off = change if number >= before else 1e-4 * number
        Memory(find_configs(None).cell().name, memory, twin=True).add(learned(f"run-{number}", off))
        return SimpleNamespace(run=f"runs/run-{number}")

    return fold


@pytest.mark.parametrize("cell", series.WRONG_CELLS)
def test_every_wrong_cell_is_a_plant_of_the_twin(cell: str) -> None:
    assert series.WRONG_CELLS[cell] or series.THICKER[cell]
    for name, values in series.WRONG_CELLS[cell].items():
        check_effects({name: values}, origin=cell, of=registry()[name].of)
