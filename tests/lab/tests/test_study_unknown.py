"""The study of unknown strips writes what makes predictions as sure as they say."""

import numpy as np
import pytest

from tests.lab.studies.catalogue.unknown import model_limits, untrained_sigma
from tests.lab.studies.study import Case, Outcome


@pytest.mark.parametrize("used", [0.0, 3e-4])
def test_what_is_added_to_sigma_makes_it_right_whatever_was_added_before(
    used: float,
) -> None:
    rng = np.random.default_rng(0)
    trained = rng.uniform(2e-4, 6e-4, 400)
    surprise = np.hypot(trained, 5e-4) * rng.standard_normal(400)
    stated = np.hypot(trained, used)
    outcomes = [
        Outcome(Case(i, 0, {}), {"surprise": s, "sigma": g, "untrained": used})
        for i, (s, g) in enumerate(zip(surprise.tolist(), stated.tolist(), strict=True))
    ]
    found = untrained_sigma(
        [*outcomes, Outcome(Case(400, 0, {}), {"outcome": "force"})]
    )
    assert found["added"] == pytest.approx(5e-4, rel=0.15)
    assert found["within_1"] == pytest.approx(0.68, abs=0.01)
    assert found["within_2"] == pytest.approx(0.95, abs=0.03)
    assert found["folds"] == 400


def test_limits_are_those_of_folds_that_hide_nothing_strange() -> None:
    values = {"residual": 1e-3, "yield_curvature": 50.0}
    lost = {"residual": None, "yield_curvature": None}
    hidden = {"friction": values, "seam": lost, "stretch": {**values, "residual": 1.0}}
    cases = [Case(i, 0, {"hidden": name}) for i, name in enumerate(hidden)]
    found = model_limits(list(map(Outcome, cases, hidden.values())))
    assert (found["residual"], found["yield_curvature"], found["folds"]) == (
        1e-3,
        50,
        1,
    )
