"""What is believed beside a law that is not quite true, and of runs that went another way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import special

from cell.gap.diagnosis import lack_of_fit
from cell.gap.selection.choice import choose, leaves_nothing, needed_models
from cell.gap.selection.fits import Fits
from cell.gap.selection.posterior import Posterior, Weighed
from cell.gap.selection.rivals import classes, more_probable, probable_rivals
from cell.gap.subject.subject import Scope
from drivers.types import Array
from tests.cell.gap import test_gap_engine
from tests.cell.gap.test_gap_engine import Curves, Law, bump, fitted, hidden, judged, wave
from tests.cell.gap.test_gap_robust import validated

UNTRUE = 0.4


def fast(t: Array, speed: float, index: int) -> Array:
    return bump(t, speed, index) * (speed > 0.9)


def slow(t: Array, speed: float, index: int) -> Array:
    return wave(t, speed, index) * (speed < 0.9)


def quick(t: Array, speed: float, index: int) -> Array:
    return wave(t, speed, index) * (speed > 2.5)


class Roughly(Curves):
    """Curves whose laws are wrong by a share of what they explain."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        rough = tuple(replace(c, model_error=UNTRUE) for c in whole.candidates)
        return replace(whole, candidates=rough)


@pytest.fixture(autouse=True)
def laws(monkeypatch: pytest.MonkeyPatch) -> None:
    more = {**test_gap_engine.LAWS, "fast": fast, "slow": slow, "quick": quick}
    monkeypatch.setattr(test_gap_engine, "LAWS", more)


def pool_of(law: Law, *names: tuple[str, ...]) -> Fits:
    subject = Roughly(law, names=("bump", "fast", "wave", "slow", "quick"))
    return Fits(tuple(validated(fitted(subject, n), subject) for n in ((), *names)))


def sets_of(nats: dict[tuple[str, ...], float]) -> Posterior:
    """Posterior of sets with these log evidences [nats]."""
    p = special.softmax(list(nats.values()))
    rows = zip(nats.items(), p, strict=True)
    ranked = [Weighed(frozenset(names), value, share) for (names, value), share in rows]
    return Posterior(tuple(sorted(ranked, key=lambda w: -w.nats)))


def test_a_law_takes_the_blame_for_a_share_of_what_it_explains_where_it_explains_it() -> None:
    apart = pool_of(lambda t, s, i: 2.0 * fast(t, s, i) + 0.05 * slow(t, s, i), ("fast",))
    assert not leaves_nothing(apart.models[1], apart)
    mixed = pool_of(lambda t, s, i: 2.0 * bump(t, s, i) + 0.05 * quick(t, s, i), ("bump",))
    assert leaves_nothing(mixed.models[1], mixed)


@pytest.mark.parametrize(
    ("nats", "accepted"),
    [
        ((30.0, 5.0, 33.0), {"bump"}),
        ((30.0, 5.0, 35.0), {"bump", "wave"}),
        ((-20.0, -30.0, 9.0), {"bump", "wave"}),
        ((-20.0, -30.0, 3.0), set()),
        ((3.0, 2.0, 3.9), set()),
        ((5.0, 30.0, 33.0), {"wave"}),
    ],
)
def test_the_most_probable_set_is_accepted_that_clearly_leads_its_parts_and_the_base(
    nats: tuple[float, float, float], accepted: set[str]
) -> None:
    names = (("bump",), ("wave",), ("bump", "wave"))
    fits = pool_of(lambda t, s, i: 0.3 * bump(t, s, i) - 0.3 * wave(t, s, i), *names)
    sets = sets_of({(): 0.0, **dict(zip(names, nats, strict=True))})
    assert choose(fits, sets).accepted.model.names == accepted
    found = [m.model.names for m in needed_models(fits, sets)]
    assert found[:1] == ([accepted] if accepted else [])


def test_what_predicts_no_better_than_a_part_of_it_is_not_accepted_however_probable() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",))
    sets = sets_of({(): 0.0, ("bump",): 50.0})
    base, bumpy = fits.models
    worse = replace(bumpy, left_out=tuple(2.0 * r for r in base.left_out))
    assert choose(fits, sets).accepted is bumpy
    assert choose(Fits((base, worse)), sets).accepted is base


def test_a_set_whose_parts_were_not_fitted_has_to_lead_the_base() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump", "wave"))
    for lead, accepted in ((5.0, {"bump", "wave"}), (3.0, set())):
        sets = sets_of({(): 0.0, ("bump", "wave"): lead})
        assert choose(fits, sets).accepted.model.names == accepted


def test_errors_of_laws_may_decide_between_sets_that_both_lead_the_base_by_far() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",), ("wave",))
    accepted = fits.models[1]
    base, bumpy, wavy = (frozenset(n) for n in ((), {"bump"}, {"wave"}))
    for lead, rivalled in ((1000.0, True), (100.0, False)):
        ranked = (Weighed(bumpy, lead, 1.0), Weighed(wavy, lead - 20.0, 0.0), Weighed(base, 0, 0))
        close = probable_rivals(accepted, fits, Posterior(ranked))
        assert [r.model.model.names for r in close] == [wavy] * rivalled


def test_errors_of_laws_decide_for_no_effect_that_explains_little_in_place_of_another() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump", "wave"), ("bump", "slow"))
    names = [frozenset(n) for n in ((), {"bump"}, {"bump", "wave"}, {"bump", "slow"})]
    accepted = fits.of(names[2])
    for nats, rivalled in ((40.0, True), (5.0, False)):
        ranked = zip(names, (0.0, 1000.0, 1060.0, 1000.0 + nats), strict=True)
        sets = Posterior(tuple(Weighed(n, lead, 0.0) for n, lead in ranked))
        close = probable_rivals(accepted, fits, sets)
        assert [r.model.model.names for r in close] == [names[3]] * rivalled


def test_an_accepted_effect_that_is_rather_absent_shares_its_place_with_what_is_more_probable() -> (
    None
):
    fits = pool_of(hidden(bump, 0.3), ("bump",), ("wave",))
    accepted = fits.models[1]
    base, bumpy, wavy = (frozenset(n) for n in ((), {"bump"}, {"wave"}))
    for p, expected in ((0.6, []), (0.4, [["bump", "wave"]])):
        both = [Weighed(bumpy, 30.0 + np.log(p), p), Weighed(wavy, 30.0 + np.log(1 - p), 1 - p)]
        ranked = sorted(both, key=lambda w: -w.p)
        sets = Posterior((*ranked, Weighed(base, 0.0, 0.0)))
        doubts = more_probable(accepted, fits, sets)
        assert classes(accepted, doubts) == expected


def astray(*runs: int) -> Law:
    """A hidden bump, and runs that besides went another way."""
    law = hidden(bump, 0.3)
    return lambda t, s, i: law(t, s, i) + 0.5 * np.cos(25.0 * t) * (i in runs)


@pytest.fixture
def single(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every run is of a condition of its own."""
    more = {f"v{i}": 0.6 + 0.3 * i for i in range(7)}
    monkeypatch.setattr(test_gap_engine, "SPEEDS", {**test_gap_engine.SPEEDS, **more})


@pytest.mark.usefixtures("single")
def test_one_run_that_went_another_way_is_told_and_does_not_hide_what_the_others_show() -> None:
    _, verdict = judged(Curves(astray(4), repeats=1))
    assert [e.name for e in verdict.effects] == ["bump"]
    assert verdict.unexplained is not None
    assert "run r4 goes another way" in verdict.unexplained.description


@pytest.mark.usefixtures("single")
def test_where_two_runs_go_another_way_the_cause_stays_open() -> None:
    _, verdict = judged(Curves(astray(4, 5), repeats=1))
    assert verdict.verdict == "unexplained"


@pytest.mark.usefixtures("single")
@pytest.mark.parametrize("shape", [bump, wave, lambda t, s, i: np.cos(25.0 * t)])
def test_a_mishap_in_one_run_is_no_effect(shape: Law) -> None:
    _, verdict = judged(Curves(lambda t, s, i: 0.3 * shape(t, s, i) * (i == 4), repeats=1))
    assert verdict.verdict == "unexplained"


def test_a_run_is_set_aside_only_where_enough_others_bear_that_out() -> None:
    many, few = (fitted(Curves(astray(2), repeats=n), ("bump",)) for n in (2, 1))
    name, samples = lack_of_fit.outlying_run(many)
    assert (name, samples.sum()) == ("r2", 60)
    name, samples = lack_of_fit.outlying_run(few)
    assert (name, samples.sum()) == (None, 0)
