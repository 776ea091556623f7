"""An effect that does nothing up to a threshold is fitted from beyond it."""

import numpy as np
import pytest

from cell.gap.fitting.projection import projection
from cell.gap.fitting.tasks import run_all
from cell.gap.selection.fits import Fits
from cell.gap.selection.score import Score
from cell.gap.selection.screening import probe, ranking, table
from cell.gap.selection.search import fit_scores
from cell.gap.subject.subject import Candidate, Parameter, Scope
from drivers.types import Array
from tests.cell.gap.test_gap_engine import Curves, T, bump, fitted
from tests.cell.gap.test_gap_robust import validated

THRESHOLD, PROBES, CREEP = 0.5, (0.3, 1.0, 3.0), 0.02


class Slipping(Curves):
    """Curves with a bump as high as an effect is beyond its threshold."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        size = Parameter("size", "m", 0.0, 0.0, 5.0, 1e-3, 1.0)
        slip = Candidate("slip", "it slips", "strip", (size,), tuple(((p,),) for p in PROBES))
        return Scope(whole.base, (slip,), whole.quantities)

    def added(self, name: str, values: Array, speed: float) -> Array:
        return slipped(values[0]) * bump(T, speed, 0)


class Uneven(Curves):
    """Curves that may have a lump, which counts ten times as much off the middle."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        parameters = (
            Parameter("size", "m", 0.0, -5.0, 5.0, 1e-3, 1.0),
            Parameter("place", "m", 0.5, 0.0, 1.0, 1e-3, 1.0, shape=True),
        )
        probes = tuple(((0.1, place),) for place in (0.15, 0.48, 0.85))
        return Scope(
            whole.base,
            (Candidate("lump", "a lump", "strip", parameters, probes),),
            whole.quantities,
        )

    def added(self, name: str, values: Array, speed: float) -> Array:
        return uneven_lump(*values)


def uneven_lump(size: float, place: float) -> Array:
    weight = 0.1 + 0.9 * min(1.0, abs(place - 0.5) / 0.1)
    return size * weight * np.exp(-(((T - place) / 0.08) ** 2))


def slipped(size: float) -> float:
    """Hardly anything up to the threshold: ends creep before they slip."""
    return CREEP * size + max(0.0, size - THRESHOLD)


def screened(size: float) -> tuple[Slipping, Score]:
    subject = Slipping(lambda t, s, i: slipped(size) * bump(t, s, i))
    return subject, best_score(subject)


def best_score(subject: Curves) -> Score:
    base = fitted(subject)
    probes = run_all(subject.simulate, [probe(base, c) for c in subject.scope.candidates])
    return ranking(table(projection(base), probes))[0]


def test_every_probe_of_an_effect_with_a_threshold_is_a_start() -> None:
    _, score = screened(0.6)
    assert score.start["slip"][0] < THRESHOLD
    assert [start["slip"][0] for start in score.tried] == list(PROBES)


def test_an_effect_that_answers_more_at_another_place_has_no_threshold() -> None:
    score = best_score(Uneven(lambda _t, _s, _i: uneven_lump(0.3, 0.15)))
    assert score.start["lump"] == pytest.approx([0.3, 0.15], rel=0.05)
    assert [start["lump"][1] for start in score.tried] == [0.15]


@pytest.mark.parametrize("size", [0.55, 0.6, 0.9, 2.0])
def test_what_slips_a_little_beyond_its_threshold_is_found(size: float) -> None:
    subject, score = screened(size)
    fits = Fits((validated(fitted(subject), subject),))
    (found,) = fit_scores(subject.simulate, fits, [score], list(subject.scope.candidates)).of_size(
        1
    )
    assert found.estimate.shared[2] == pytest.approx(size, abs=0.02)
    assert np.mean(np.concatenate(found.estimate.residuals) ** 2) < 1.5
