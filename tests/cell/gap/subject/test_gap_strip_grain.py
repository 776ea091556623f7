"""What the coarse rod shows more than a fine one, where a single grain may go astray."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cell.gap.subject.strip import prepare
from cell.gap.subject.strip.simulation import FINE, FINER, Resolution
from drivers.types import Array

FLOOR = 1e-3
ASTRAY, STEADY = 8 * FLOOR, 0.5 * FLOOR  # what the fine rod shows of two folds


def folded(of: str, samples: int = 2) -> Any:
    """A fold of so many samples, of which a motion shows its own name and value."""

    def compared(_model: object, motion: tuple[str, float]) -> Any:
        assert motion[0] == of
        return SimpleNamespace(mean=np.full(samples, motion[1]))

    layout = SimpleNamespace(samples=SimpleNamespace(floor=np.full(samples, FLOOR)))
    comparison = type("", (), {"__call__": lambda _, *a: compared(*a), "layout": layout})
    return SimpleNamespace(comparison=comparison())


def grains(
    monkeypatch: pytest.MonkeyPatch, finer: float, samples: int = 2
) -> tuple[list[Array], list[Any]]:
    """Grains of a fold that goes astray and of a steady one, and what was simulated."""
    asked: list[Any] = []
    shows = {FINE: {"slips": ASTRAY, "lies": STEADY}, FINER: {"slips": finer, "lies": 0.0}}

    def simulation(resolution: Resolution, _jobs: int) -> Any:
        def simulated(drives: list[Any]) -> list[tuple[str, float]]:
            asked.append((resolution, [d.of for d in drives]))
            return [(d.of, shows[resolution][d.of]) for d in drives]

        return simulated

    monkeypatch.setattr(prepare, "Simulation", simulation)
    folds = [folded("slips", samples), folded("lies", samples)]
    drives: Any = [SimpleNamespace(of=of, model=None) for of in ("slips", "lies")]
    return prepare._grid_errors(folds, drives, [np.zeros(samples), np.zeros(samples)], 1), asked


@pytest.mark.parametrize("finer", [0.1 * FLOOR, 1.1 * ASTRAY])
def test_where_the_fine_rod_goes_another_way_a_finer_one_decides(
    monkeypatch: pytest.MonkeyPatch, finer: float
) -> None:
    (slips, lies), asked = grains(monkeypatch, finer)
    assert asked == [(FINE, ["slips", "lies"]), (FINER, ["slips"])]
    assert slips == pytest.approx(-finer)
    assert lies == pytest.approx(-STEADY)


def test_a_run_that_broke_off_before_its_first_sample_asks_for_no_finer_rod(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, asked = grains(monkeypatch, 0.0, samples=0)
    assert asked == [(FINE, ["slips", "lies"]), (FINER, [])]
