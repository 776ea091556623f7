"""The subjects of the study of engines are what they are said to be."""

import numpy as np
import pytest

from drivers.strip.rod.engine import Rod
from policies.path import triangular
from tests.lab.studies.catalogue.engines import DT, steady
from tests.lab.studies.kit.paper_formulation import PaperFormulation
from tests.support.rod_cases import paper_model

pytestmark = pytest.mark.slow


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
