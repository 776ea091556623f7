"""Which models are worth refitting after others were."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cell.gap.diagnosis.invariance import invariance
from cell.gap.fitting.crossvalidation import validate
from cell.gap.fitting.model import Model
from cell.gap.fitting.projection import projection
from cell.gap.fitting.tasks import run_one
from cell.gap.selection.choice import leaves_nothing
from cell.gap.selection.fits import Fits
from cell.gap.selection.refinement import shape_parameters
from cell.gap.selection.score import Score
from cell.gap.selection.screening import probe, ranking, table
from cell.gap.selection.search import (
    shortlist,
    substitutes,
    with_shape_parameters,
    without_each,
)
from cell.gap.subject.subject import Parameter, Request, Residuals, Scope
from drivers.types import Array
from tests.cell.gap import test_gap_engine
from tests.cell.gap.test_gap_engine import Curves, Law, bump, hidden, wave
from tests.cell.gap.test_gap_engine import fitted as at
from tests.cell.gap.test_gap_robust import validated

BOTH: Law = lambda t, s, i: 0.2 * bump(t, s, i) - 0.15 * wave(t, s, i)  # noqa: E731
FAINT: Law = lambda t, s, i: 2.0 * bump(t, s, i) - 0.002 * wave(t, s, i)  # noqa: E731


def test_nothing_is_searched_beside_what_leaves_too_little() -> None:
    for law, done in ((hidden(bump, 0.2), True), (FAINT, True), (BOTH, False)):
        subject = Curves(law)
        models = [validated(at(subject, names), subject) for names in ((), ("bump",))]
        assert leaves_nothing(models[1], Fits(tuple(models))) is done


def test_what_immaterial_effects_would_leave_is_too_little() -> None:
    subject = Curves(BOTH)
    models = tuple(validated(at(subject, names), subject) for names in ((), ("bump",)))
    waves = next(c for c in subject.scope.candidates if c.name == "wave")
    responses = run_one(subject.simulate, probe(models[0].estimate, waves)).responses[1]
    assert not leaves_nothing(models[1], Fits(models, {"wave": 1e-3 * responses}))
    assert leaves_nothing(models[1], Fits(models, {"wave": 1e3 * responses}))


def test_a_base_never_ends_the_search() -> None:
    subject = Curves(hidden(bump, 0.2))
    base = validated(at(subject), subject)
    assert not leaves_nothing(base, Fits((base,)))


def test_singles_begin_again_from_a_better_pair_though_it_was_not_accepted() -> None:
    subject = Curves(hidden(bump, 0.2))
    base, pair = (validated(at(subject, n), subject) for n in ((), ("bump", "wave")))
    scores = without_each(Fits((base, pair)), base)
    assert [s.names for s in scores[-2:]] == [("wave",), ("bump",)]
    assert all(s.after is pair.estimate for s in scores)
    assert [s.names for s in without_each(Fits((base,)), base)] == []


def broad(t: Array, speed: float, index: int) -> Array:
    return bump(t, speed, index) + 0.3 * np.exp(-(((t - 0.35) / 0.2) ** 2))


def test_each_effect_of_the_accepted_model_is_replaced_by_what_explains_most_beside_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    laws = {**test_gap_engine.LAWS, "broad": broad}
    monkeypatch.setattr(test_gap_engine, "LAWS", laws)
    subject = Curves(
        lambda t, s, i: 0.2 * broad(t, s, i) - 0.15 * wave(t, s, i), names=("bump", "wave", "broad")
    )
    sets = ((), ("bump",), ("wave",), ("bump", "wave"))
    fits = Fits(tuple(validated(at(subject, names), subject) for names in sets))
    scores = substitutes(subject.simulate, fits, fits.models[3], subject.scope.candidates)
    assert {s.names for s in scores} == {("broad", "wave"), ("broad", "bump")}
    assert all(s.after is not None and s.after.model.names < frozenset(s.names) for s in scores)
    more = fits.merge([validated(at(subject, ("broad", "wave")), subject)])
    (score,) = substitutes(subject.simulate, more, fits.models[3], subject.scope.candidates)
    assert score.names == ("broad", "bump")
    single = Fits(fits.models[:2])
    assert substitutes(subject.simulate, single, fits.models[1], subject.scope.candidates) == []


class Bending(Curves):
    """Curves whose bump may lean: its finer parameter adds a share of its slope."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        lean = Parameter("lean", "1", 0.0, 0.0, 5.0, 1e-3, 1.0, shape=True)
        first, *others = whole.candidates
        return replace(whole, candidates=(replace(first, shape_parameters=(lean,)), *others))

    def simulate(self, requests: Sequence[Request]) -> list[Residuals]:
        found = super().simulate(requests)
        for q, residuals in zip(requests, found, strict=True):
            size, lean = (*q.effects.get("bump", (0.0,)), 0.0)[:2]
            speed = {"slow": 0.5, "medium": 1.0, "fast": 2.0, "faster": 3.0}[q.run.condition]
            residuals.mean[:] -= size * lean * leaning(np.linspace(0.0, 1.0, 60), speed, 0)
        return found


def leaning(t: np.ndarray, speed: float, _: int) -> np.ndarray:
    return 5.0 * (t - 0.5) * bump(t, speed, 0)


def pool_of(lean: float) -> Fits:
    subject = Bending(lambda t, s, i: 0.2 * bump(t, s, i) + 0.2 * lean * leaning(t, s, i))
    found = [at(subject, names) for names in ((), ("bump",))]
    return Fits(tuple(run_one(subject.simulate, validate(fit)) for fit in found))


def test_pairs_are_sifted_by_how_far_a_fit_gets_not_by_the_screen() -> None:
    subject = Curves(BOTH)
    base = at(subject)
    some = np.array([0.1])
    screened = [Score(names, gain, dict.fromkeys(names, some), linear=False)
                for names, gain in ((("bump", "dead"), 9.0), (("bump", "wave"), 1.0))]  # fmt: skip
    (first,) = shortlist(subject.simulate, base, screened, subject.scope.candidates, 1)
    assert first.names == ("bump", "wave")
    (start,) = first.starts
    assert [start[n][0] for n in first.names] == pytest.approx([0.2, -0.15], abs=0.02)


def test_law_that_only_resembles_the_librarys_is_bent() -> None:
    subject, pool = Bending(BOTH), pool_of(lean=0.5)
    (found,) = shape_parameters(subject.simulate, pool)
    assert found.estimate.shared[2:] == pytest.approx([0.2, 0.5], abs=0.02)
    (known, *_) = with_shape_parameters(subject.scope.candidates, pool.merge([found]))
    assert [p.name for p in known.parameters] == ["size", "lean"]
    assert not known.shape_parameters


def test_law_that_holds_is_not_bent() -> None:
    assert shape_parameters(Bending(BOTH).simulate, pool_of(lean=0.0)) == []


def test_values_of_a_law_that_was_not_bent_start_its_bent_one() -> None:
    scope = Bending(BOTH).scope
    model = Model(scope.base, (scope.candidates[0].with_shape(),))
    joined = model.join(np.array([1.0, 2.0]), {"bump": np.array([0.3])})
    assert joined == pytest.approx([1.0, 2.0, 0.3, 0.0])


def test_an_effect_of_a_pair_has_one_amplitude_in_all_phases_of_a_motion() -> None:
    halved: Law = lambda t, s, i: BOTH(t, s, i) - 0.1 * bump(t, s, i) * (t > 0.5)  # noqa: E731
    for law, holds in ((BOTH, True), (halved, False)):
        subject = Curves(law)
        models = [validated(at(subject, names), subject) for names in ((), ("bump", "wave"))]
        by = Fits(tuple(models)).scale
        fit = models[1].estimate
        found = run_one(subject.simulate, invariance(fit, "bump", by, phases=True))
        assert found.holds is holds
        assert run_one(subject.simulate, invariance(fit, "bump", by)).holds


def test_a_bent_law_is_screened_beside_another_effect() -> None:
    subject = Bending(hidden(wave, 0.2))
    bent = subject.scope.candidates[0].with_shape()
    found = run_one(subject.simulate, probe(at(subject, ("wave",)), bent))
    assert all(v.shape == (2,) for group in found.groups for v in group)
    (score,) = ranking(table(projection(at(subject, ("wave",))), [found]))
    assert score.names == ("bump",)
