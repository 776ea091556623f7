"""An effect with a place is tried with either sign, each where it gains most with it."""

from collections.abc import Sequence

import numpy as np
import pytest

from cell.gap.fitting.gauss_newton import Estimate, refit
from cell.gap.fitting.model import Model, Point, evidence
from cell.gap.fitting.projection import projection
from cell.gap.fitting.starts import best
from cell.gap.fitting.tasks import run_all, run_one
from cell.gap.selection.fits import Fits
from cell.gap.selection.refinement import other_signs
from cell.gap.selection.revision import refit_on_base
from cell.gap.selection.score import Score
from cell.gap.selection.screening import probe, ranking, table
from cell.gap.subject.subject import Candidate, Parameter, Scope
from drivers.types import Array
from tests.cell.gap.test_gap_engine import LAWS, Curves, T
from tests.cell.gap.test_gap_robust import validated

PLACES = (0.15, 0.35, 0.55, 0.75)


def lump(t: Array, place: float) -> Array:
    return np.exp(-(((t - place) / 0.08) ** 2))


class Lumps(Curves):
    """Curves that may have a lump, up or down, at a place."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        least = -5.0 if self.signed else 0.0
        parameters = (
            Parameter("size", "m", 0.0, least, 5.0, 1e-3, 1.0),
            Parameter("place", "m", 0.5, 0.0, 1.0, 1e-3, 1.0, shape=True),
        )
        probes = tuple(((0.1, place),) for place in PLACES)
        found = Candidate("lump", "there is a lump", "strip", parameters, probes)
        return Scope(whole.base, (found, *whole.candidates), whole.quantities)

    def added(self, name: str, values: Array, speed: float) -> Array:
        if name != "lump":
            return super().added(name, values, speed)
        size, place = values
        return size * lump(T, place)


def two_sided(signed: bool = True, wave: float = 0.0) -> Lumps:
    """Down at 0.56, and less up at 0.34: a lump up is a local optimum, beside a `wave` too."""

    def truth(t: Array, speed: float, index: int) -> Array:
        return -0.3 * lump(t, 0.56) + 0.2 * lump(t, 0.34) + wave * LAWS["wave"](t, speed, index)

    return Lumps(truth, names=("wave",), signed=signed)


def at(subject: Lumps, *start: float, names: Sequence[str] = ("lump",)) -> Estimate:
    """Fit of the effects `names` from their values `start`; of the base without any."""
    scope, runs = subject.scope, evidence(subject.runs)
    chosen = tuple(c for c in scope.candidates if start and c.name in names)
    begin = Point(np.array([0.2, 0.5, *start]), runs.start())
    return run_one(subject.simulate, refit(Model(scope.base, chosen), runs, begin))


def screened(subject: Lumps) -> Score:
    base = at(subject)
    lumps = subject.scope.candidates[:1]
    probes = run_all(subject.simulate, [probe(base, c) for c in lumps])
    return ranking(table(projection(base), probes))[0]


def test_the_other_sign_begins_where_it_gains_most() -> None:
    score = screened(two_sided())
    assert score.mirrored is not None
    signs = {float(np.sign(v["lump"][0])): v["lump"][1] for v in (score.start, score.mirrored)}
    assert signs == {-1.0: pytest.approx(0.55), 1.0: pytest.approx(0.35)}


def test_where_one_sign_alone_is_possible_there_is_no_other() -> None:
    assert screened(two_sided(signed=False)).mirrored is None


def test_a_local_optimum_of_one_sign_is_left_for_the_other() -> None:
    subject = two_sided()
    wrong = at(subject, 0.1, 0.35)
    assert wrong.shared[2] > 0.0
    fits = Fits(tuple(validated(e, subject) for e in (at(subject), wrong)))
    (found,) = other_signs(subject.simulate, fits, fits.of_size(1))
    size, place = found.estimate.shared[2:]
    assert size < -0.2
    assert place == pytest.approx(0.56, abs=0.02)
    assert best([wrong, found.estimate]) is found.estimate


def test_beside_another_effect_too() -> None:
    subject = two_sided(wave=0.1)
    wrong = at(subject, 0.1, 0.35, 0.1, names=("lump", "wave"))
    assert wrong.shared[2] > 0.0
    others = at(subject), at(subject, 0.1, names=("wave",))
    fits = Fits(tuple(validated(e, subject) for e in (*others, wrong)))
    (found,) = other_signs(subject.simulate, fits, fits.of_size(2))
    size, place, _ = found.estimate.shared[2:]
    assert size < -0.2
    assert place == pytest.approx(0.56, abs=0.02)
    assert best([wrong, found.estimate]) is found.estimate


def test_beside_a_revised_base_too() -> None:
    subject = two_sided()
    base, wrong = (validated(e, subject) for e in (at(subject), at(subject, 0.1, 0.35)))
    assert wrong.estimate.shared[2] > 0.0
    again = refit_on_base(subject.simulate, Fits((base, wrong)), base, (), base.estimate.evidence)
    (found,) = again.of_size(1)
    assert found.estimate.shared[2] < -0.2


def test_an_effect_of_one_sign_alone_is_left_as_it_is() -> None:
    subject = Lumps(lambda t, _s, _i: 0.2 * lump(t, 0.34), names=(), signed=False)
    right = at(subject, 0.1, 0.35)
    fits = Fits(tuple(validated(e, subject) for e in (at(subject), right)))
    assert other_signs(subject.simulate, fits, fits.of_size(1)) == []


def test_a_model_without_an_effect_that_has_a_place_is_not_fitted_again() -> None:
    subject = two_sided()
    fits = Fits((validated(at(subject), subject),))
    assert other_signs(subject.simulate, fits, fits.models) == []
