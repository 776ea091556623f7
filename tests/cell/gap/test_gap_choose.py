"""What is believed beside a law that is not quite true, and of runs that went another way."""

from dataclasses import replace

import numpy as np
import pytest

from cell.gap.diagnosis import lack_of_fit
from cell.gap.selection import choice
from cell.gap.selection.choice import by_evidence, choose, is_exhausted
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import share_removed
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


def test_a_law_takes_the_blame_for_a_share_of_what_it_explains_where_it_explains_it() -> None:
    apart = pool_of(
        lambda t, s, i: 2.0 * fast(t, s, i) + 0.05 * slow(t, s, i), ("fast",), ("fast", "slow")
    )
    assert choose(apart).accepted.model.names == {"fast", "slow"}
    assert not is_exhausted(Fits(apart.models[:2]))
    mixed = pool_of(
        lambda t, s, i: 2.0 * bump(t, s, i) + 0.05 * quick(t, s, i), ("bump",), ("bump", "quick")
    )
    assert choose(mixed).accepted.model.names == {"bump"}
    assert is_exhausted(Fits(mixed.models[:2]))


def test_evidence_shows_an_effect_whose_amount_another_number_makes_up_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",), ("wave",))
    monkeypatch.setattr(choice, "is_significant", lambda *_: False)
    assert not choose(fits).accepted.model.effects
    base, bumpy = frozenset(), frozenset({"bump"})
    for ahead, found in ((3.0, base), (30.0, bumpy)):
        sets = Posterior((Weighed(bumpy, ahead, 0.9), Weighed(base, 0.0, 0.1)))
        assert sets.gain(bumpy, "bump") == ahead
        assert choose(fits, sets).accepted.model.names == found
    assert sets.gain(frozenset({"bump", "wave"}), "wave") == float("-inf")


def test_where_no_margin_explains_a_gap_the_evidence_chooses_and_says_what_is_as_probable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",), ("wave",), ("slow",))
    monkeypatch.setattr(choice, "_is_earned", lambda *_: False)
    names = {name: frozenset({name} - {""}) for name in ("", "bump", "wave", "slow")}
    nats = {"bump": 30.0, "wave": 28.0, "slow": 5.0, "": 0.0}
    sets = Posterior(tuple(Weighed(names[n], v, 0.0) for n, v in nats.items()))
    found = by_evidence(choose(fits, sets), sets)
    assert found.accepted.model.names == {"bump"}
    close = probable_rivals(found.accepted, fits, sets)
    assert [(r.model.model.names, r.behind) for r in close] == [({"wave"}, 2.0)]
    doubtful = Posterior((Weighed(names["bump"], 3.0, 0.9), Weighed(names[""], 0.0, 0.1)))
    assert not by_evidence(choose(fits, doubtful), doubtful).accepted.model.effects


def test_what_is_less_probable_than_no_effect_is_not_accepted() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",))
    base, bumpy = frozenset[str](), frozenset({"bump"})
    assert choose(fits).accepted.model.names == bumpy
    for nats, expected in ((2.0, bumpy), (-2.0, base)):
        ranked = sorted([Weighed(bumpy, nats, 0.5), Weighed(base, 0.0, 0.5)], key=lambda w: -w.nats)
        found = by_evidence(choose(fits), Posterior(tuple(ranked)))
        assert found.accepted.model.names == expected
        assert any(step.accepted for step in found.steps) == bool(expected)


def test_what_is_less_probable_than_no_effect_gives_way_to_what_clearly_leads() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",), ("wave",))
    base, bumpy, wavy = (frozenset(n) for n in ((), {"bump"}, {"wave"}))
    ranked = (Weighed(wavy, 9.0, 0.9), Weighed(base, 0.0, 0.1), Weighed(bumpy, -2.0, 0.0))
    found = by_evidence(choose(fits), Posterior(ranked))
    assert found.accepted.model.names == wavy
    assert [step.accepted for step in found.steps] == [False, True]


def test_errors_of_laws_may_decide_between_sets_that_both_lead_the_base_by_far() -> None:
    fits = pool_of(hidden(bump, 0.3), ("bump",), ("wave",))
    accepted = choose(fits).accepted
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
    found = choose(fits)
    base, bumpy, wavy = (frozenset(n) for n in ((), {"bump"}, {"wave"}))
    for p, expected in ((0.6, []), (0.4, [["bump", "wave"]])):
        both = [Weighed(bumpy, 30.0 + np.log(p), p), Weighed(wavy, 30.0 + np.log(1 - p), 1 - p)]
        ranked = sorted(both, key=lambda w: -w.p)
        sets = Posterior((*ranked, Weighed(base, 0.0, 0.0)))
        doubts = more_probable(found.accepted, fits, sets)
        assert classes(found.accepted, doubts) == expected


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


def test_what_a_model_removes_can_be_asked_without_a_run() -> None:
    subject = Curves(astray(4))
    base, model = (validated(fitted(subject, n), subject) for n in ((), ("bump",)))
    by = Fits((base, model)).scale
    assert share_removed(model, base, by) < 0.7
    assert share_removed(model, base, by, "r4") > 0.95
