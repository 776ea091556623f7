"""What could be gained by pairs of effects, and which of them are looked at closely."""

import pytest

from cell.gap.fitting.projection import projection
from cell.gap.fitting.tasks import run_one
from cell.gap.selection.screening import probe
from tests.cell.gap.test_gap_engine import Curves, bump, fitted, hidden


def test_what_may_be_there_besides_speaks_for_no_effect_like_it() -> None:
    """Sherman and Morrison: beside a response of one sigma both shrink by 1 + its square."""
    subject = Curves(hidden(bump, 0.2))
    base = fitted(subject)
    bumps = next(c for c in subject.scope.candidates if c.name == "bump")
    response = run_one(subject.simulate, probe(base, bumps)).responses[1]
    plain, wary = projection(base), projection(base, nuisance=[response])
    before, after = (about.form(about.weigh(response)) for about in (plain, wary))
    square = before.curvature[0, 0]
    assert after.curvature[0, 0] == pytest.approx(square / (1.0 + square))
    assert after.gradient[0] == pytest.approx(before.gradient[0] / (1.0 + square))
