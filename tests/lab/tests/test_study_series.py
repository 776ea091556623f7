"""The study of folds in a row: its wrong cells exist, and it says what the cell noticed."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cell.config.places import find_configs
from cell.folding.request import Learning, with_correction
from cell.learning.correction import subject_of
from cell.learning.experience import Experience, Memory
from drivers.strip.effects import check_effects, registry
from tests.lab.studies.catalogue import series
from tests.lab.studies.kit.folds import SPECIMEN_NAME
from tests.support.requests import request_for

CASES = {(c.values["cell"], c.values["series"]): c.values for c in series.STUDY.cases(0, 12)}
MOVED = ("tool 3 mm off", series.CHANGED_SERIES)


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


@pytest.mark.parametrize(("change", "noticed"), [(0.002, True), (-0.003, True), (0.0, False)])
def test_a_change_in_mid_series_is_noticed(
    monkeypatch: pytest.MonkeyPatch, change: float, noticed: bool
) -> None:
    monkeypatch.setattr(series, "_fold", made(change, series.FOLDS_BEFORE))
    monkeypatch.setattr(series, "_facts", lambda *_: {"true": 5e-4})
    found = series.measure(CASES[MOVED])
    assert (found["noticed"], found["alarm"]) == (noticed, False)
    assert found["worse"] == pytest.approx(0.0)


def test_a_change_of_a_right_cell_is_a_false_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(series, "_fold", made(0.002, 1))
    monkeypatch.setattr(series, "_facts", lambda *_: {})
    found = series.measure(CASES["right", series.LONG_SERIES])
    assert (found["noticed"], found["alarm"], found["worse"]) == (None, True, None)


def test_a_fold_is_corrected_by_the_memory_that_it_names(tmp_path: Path) -> None:
    learning = Learning(SPECIMEN_NAME, tmp_path)
    request = request_for("unknown:0.6", "adaptive", tmp_path, learning=learning)
    assert with_correction(request, "on").learning.correction.seen == 0.0
    Memory(find_configs(None).cell().name, tmp_path, twin=True).add(learned("run-0", 0.002))
    assert with_correction(request, "on").learning.correction.seen == pytest.approx(0.002, rel=0.1)
