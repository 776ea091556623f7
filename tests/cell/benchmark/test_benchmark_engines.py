"""The subjects of the benchmark of engines are what they are said to be."""

import sys

import numpy as np
import pytest

from drivers.strip.rod.engine import Rod
from policies.path import triangular
from tests.benchmarks import bench_engines
from tests.benchmarks.bench_engines import DT, Measured, folds, one_by_one, row, together
from tests.benchmarks.paper_formulation import PaperFormulation
from tests.support.rod_cases import paper_model, steady


@pytest.fixture(scope="module")
def lifted() -> dict[str, tuple[float, np.ndarray]]:
    """Where the strip leaves the desk, and its grasped end from the gripper, by engine."""
    poses = steady(triangular(0.6), DT)[:200]
    found = {}
    for name, engine in (("paper", PaperFormulation()), ("rod", Rod(100))):
        engine.reset([paper_model(0.0775, 7.0)])
        for pose in poses:
            shown = engine.step(pose[None], DT)
        found[name] = float(shown.contact_x[0]), engine.shapes()[0, -1] - poses[-1, :2]
    return found


def test_papers_formulation_lifts_the_strip_as_the_rod_does(lifted: dict) -> None:
    assert lifted["paper"][0] == pytest.approx(lifted["rod"][0], abs=0.012)


def test_grip_of_the_papers_formulation_is_soft_and_that_of_the_rod_is_not(lifted: dict) -> None:
    assert np.hypot(*lifted["rod"][1]) < 1e-9
    assert np.hypot(*lifted["paper"][1]) > 1e-3


def test_same_folds_give_the_same_displacement_side_by_side_and_one_by_one() -> None:
    few = folds(quick=True)[:2]
    batch, each = together(Rod(40), few), one_by_one(Rod(40), few)
    np.testing.assert_allclose(batch.d, each.d, atol=1e-6)
    np.testing.assert_allclose(batch.spans, each.spans, atol=2 * DT)
    assert batch.cost > 0


def test_row_counts_what_was_not_finite(capsys: pytest.CaptureFixture[str]) -> None:
    found = Measured(np.array([0.001, np.nan]), np.array([5.0, np.nan]), cost=0.01)
    row("subject", found, np.zeros(2))
    told = capsys.readouterr().out
    assert "2.00 ms/s" in told
    assert "1.00 worst" in told
    assert "1 of 2 not finite" in told


def test_pyelastica_is_left_out_where_it_is_not_installed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "elastica", None)
    bench_engines.elastica()
    assert "not installed" in capsys.readouterr().out
