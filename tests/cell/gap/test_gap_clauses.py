"""One claim for each condition by which a model is chosen, doubted, named or left."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cell.gap import forward_selection
from cell.gap.diagnosis.lack_of_fit import Bin, ResidualTest
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.model import Model, Point
from cell.gap.selection import hold_out
from cell.gap.selection.choice import choose, rivals
from cell.gap.selection.likelihood import Fits, LikelihoodScale
from cell.gap.selection.posterior import Posterior, SetProbability
from cell.gap.subject.subject import Candidate
from cell.gap.verdict.compose import intervals
from cell.gap.verdict.decision import GAP, decide, doubtful_values
from cell.gap.verdict.findings import DecidedVerdict, Findings
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter, Role
from tests.support import curves
from tests.support.curves import (
    Curves,
    Touched,
    both,
    bump,
    fitted,
    hidden,
    judged,
    nothing,
    validated,
)

PLACE = Bin("angle", "lift", "middle", "slow", 5.0, 1e-3)


class Known(Fits):
    """Fits whose log likelihoods count as they are."""

    __slots__ = ()
    likelihood = LikelihoodScale(1.0, 1.0)


def model(*names: str, nats: Sequence[float] = (0.0,), error: float = 0.0) -> Any:
    """A fit of effects `names` that predicts runs left out by `nats` better than
    none.
    """
    return SimpleNamespace(
        names=frozenset(names),
        effects=[SimpleNamespace(name=name, model_error=error) for name in names],
        name=" + ".join(names),
        proxies=[],
        left_out=nats,
        losses=lambda scale: -np.array(nats),
    )


def posterior_of(nats: dict[str, float]) -> Posterior:
    """Posterior of sets of effects, each by its names apart by blanks, of log odds
    `nats`.
    """
    order = sorted(nats, key=lambda words: -nats[words])
    return Posterior(
        [SetProbability(frozenset(w.split()), nats[w], 0.0) for w in order]
    )


def chosen(models: Sequence[Any], nats: dict[str, float]) -> set[str]:
    """Names of the effects of the chosen one of `models`, of log odds `nats`."""
    return {*choose(Known(models), posterior_of(nats)).names}


@pytest.mark.parametrize(
    ("lead", "gained", "found"),
    [(20.0, 5.0, {"a"}), (3.9, 5.0, set()), (20.0, -0.1, set())],
)
def test_an_effect_leads_none_and_predicts_better(lead, gained, found) -> None:
    models = model(), model("a", nats=[gained])
    assert chosen(models, {"": 0.0, "a": lead}) == found


@pytest.mark.parametrize(
    ("lead", "gained", "error", "found"),
    [
        (60.0, 5.0, 0.0, {"a", "b"}),
        (53.9, 5.0, 0.0, {"a"}),
        (60.0, 3.9, 0.0, {"a"}),
        (60.0, 5.0, 0.2, {"a"}),
    ],
)
def test_a_second_effect_leads_the_first_beyond_what_its_law_gets_wrong(
    lead, gained, error, found
) -> None:
    one, two = model("a", nats=[90.0], error=error), model("a", "b", nats=[90 + gained])
    nats = {"": 0.0, "a": 50.0, "a b": lead}
    assert chosen([model(), one, two], nats) == found


@pytest.mark.parametrize(
    ("overall", "place", "more"),
    [(0.5, 0.5, False), (1e-9, 0.5, True), (0.5, 1e-9, True)],
)
def test_more_than_noise_is_left_over_all_or_at_one_place(
    monkeypatch, overall, place, more
) -> None:
    bins = [SimpleNamespace(p=place)]
    left = SimpleNamespace(misfit=lambda: overall, test_bins=lambda: bins)
    monkeypatch.setattr(ResidualTest, "of", lambda *_: left)
    monkeypatch.setattr(forward_selection, "best_fitting", lambda _: None)
    assert forward_selection._leaves_more(Known((model(),))) is more


def doubt(
    lead: float, nats: Sequence[float], *, error: float = 0.0, proxy: bool = False
) -> list[set[str]]:
    """Rivals of `a`, which gains 100 nats in each of two runs; `b` has a `lead` on it
    and gains `nats`.
    """
    accepted, other = model("a", nats=[100, 100], error=error), model("b", nats=nats)
    other.proxies += ["b"] * proxy
    two = model("a", "b", nats=[100, 100])
    fits = Known((model(nats=[0, 0]), accepted, other, two))
    sets = posterior_of({"": -500.0, "a": 0.0, "b": lead, "a b": 1.0})
    return [{*m.names} for m in rivals(accepted, fits, sets)]


@pytest.mark.parametrize(
    ("lead", "nats", "error", "found"),
    [
        (-4.5, [50, 50], 0.0, [{"b"}]),  # nearly as probable
        (-4.7, [50, 50], 0.0, []),
        (-4.7, [98.1, 98.1], 0.0, [{"b"}]),  # predicts about as well
        (-4.7, [97.9, 97.9], 0.0, []),
        (-4.7, [102, 90], 0.0, [{"b"}]),  # worse within a standard error
        (-4.7, [50, 50], 0.2, [{"b"}]),  # within what the law gets wrong
        (-13.0, [50, 50], 0.2, []),
    ],
)
def test_a_rival_is_what_neither_odds_nor_prediction_exclude(
    lead, nats, error, found
) -> None:
    assert doubt(lead, nats, error=error) == found


def test_what_stands_in_for_another_law_is_no_rival() -> None:
    assert doubt(0.0, [100, 100]) == [{"b"}]
    assert doubt(0.0, [100, 100], proxy=True) == []


def spared(
    monkeypatch: pytest.MonkeyPatch, loss: Callable[[set[int]], float], repeats: int
) -> list[str]:
    """Runs held out of four conditions where leaving out runs costs a `loss`."""
    monkeypatch.setattr(
        hold_out, "_information_loss", lambda *_: lambda runs: loss({*runs})
    )
    subject = Curves(nothing, repeats=repeats)
    return hold_out.held_out(subject, subject.simulate)


@pytest.mark.parametrize(
    ("loss", "repeats", "held"),
    [
        (lambda runs: 0.0, 1, ["r1"]),
        (lambda runs: 0.6 * (1 in runs), 1, ["r2"]),  # another condition can be spared
        (lambda runs: 0.6, 1, ["r1"]),  # none can
        (lambda runs: 0.95 * (0 in runs), 2, ["r1", "r5", "r4"]),  # and it was repeated
        (lambda runs: 0.85 * (0 in runs), 2, ["r1", "r5"]),
        (lambda runs: 0.95 * (0 in runs), 1, ["r1"]),  # nor repeated
    ],
)
def test_held_out_is_what_the_others_can_spare(
    monkeypatch, loss, repeats: int, held: list[str]
) -> None:
    assert spared(monkeypatch, loss, repeats) == held


def test_two_conditions_are_spared_only_together(monkeypatch) -> None:
    monkeypatch.setattr(curves, "SPEEDS", {f"v{i}": 1.0 + i for i in range(8)})
    for together, held in (0.0, ["r1", "r5"]), (0.6, ["r1", "r6"]):
        loss = lambda runs, both=together: both * ({1, 5} <= runs)  # noqa: E731
        assert spared(monkeypatch, loss, 1) == held


@pytest.fixture
def single(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect lives in one condition alone."""

    def medium_only(t: Array, speed: float, _: int) -> Array:
        return bump(t, speed, 0) * (speed == 1.0)

    monkeypatch.setitem(curves.LAWS, "single", medium_only)  # type: ignore[misc]


@pytest.mark.usefixtures("single")
def test_a_condition_that_alone_tells_an_effect_is_fitted() -> None:
    for repeats, held in (1, ["r2"]), (2, ["r2", "r6", "r5"]):
        subject = Curves(nothing, names=("bump", "single"), repeats=repeats)
        assert hold_out.held_out(subject, subject.simulate) == held
    asked = hold_out.held_out(subject, subject.simulate, ["r3", "r0", "r3"])
    assert asked == ["r3", "r0"]


@pytest.mark.usefixtures("single")
def test_an_effect_that_hardly_shows_keeps_no_run() -> None:
    subject = Curves(nothing, names=["single"], repeats=1, noise=1e3)
    assert hold_out.held_out(subject, subject.simulate) == ["r1"]


@pytest.mark.usefixtures("single")
def test_a_value_that_one_condition_alone_knows_costs_a_nat() -> None:
    subject = Curves(nothing, names=["single"], repeats=1)
    base, with_it = (
        validated(fitted(subject, names), subject).charged for names in ([], ["single"])
    )
    assert with_it - base == pytest.approx([0.0, 1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def one() -> Findings:
    """Findings of a hidden bump, which nobody changes."""
    return judged(Curves(hidden(bump, 0.05)))[0]


@pytest.fixture(scope="module")
def two() -> Findings:
    """Findings of a bump and a wave, which nobody changes."""
    return judged(Curves(both(0.2, -0.03)))[0]


@pytest.fixture(scope="module")
def quiet() -> Findings:
    """Findings of nothing hidden, which nobody changes."""
    return judged(Curves(nothing))[0]


def alike(found: Findings, *names: str) -> Findings:
    """Copy of `found` in which effects are of one class."""
    return replace(found, model_tests=found.model_tests._replace(classes=(names,)))


def test_what_shares_a_class_is_credible_and_not_named(one, two) -> None:
    said = [decide(alike(found, "bump", "twin")) for found in (one, two)]
    assert [each.kind for each in said] == ["ambiguous", "named"]
    assert [each.named for each in said] == [(), ("wave",)]


def test_a_class_is_as_probable_as_all_its_members(one) -> None:
    sets = posterior_of({"bump": 20.0, "twin": 19.0, "": -50.0})
    alone = decide(replace(one, posterior=sets)).evidence.log_odds
    whole = decide(replace(alike(one, "bump", "twin"), posterior=sets)).evidence
    assert (alone, whole.log_odds) == pytest.approx((1.0, 70.3133), abs=1e-4)


@pytest.mark.parametrize(
    ("rival", "odds"), [("dead", 101.3133), ("wave", 2.3133)], ids=["none", "wave"]
)
def test_a_set_with_one_effect_more_does_not_speak_against_a_name(
    one, rival: str, odds: float
) -> None:
    sets = {"bump": 100.0, "bump wave": 101.0, "": 0.0}
    weighed = posterior_of(sets | ({"wave": 99.0} if rival == "wave" else {}))
    found = decide(replace(one, posterior=weighed)).evidence.log_odds
    assert found == pytest.approx(odds, abs=1e-4)


def test_an_effect_that_is_less_probable_than_not_is_not_named(one) -> None:
    decision = decide(replace(one, posterior=posterior_of({"bump": 0.0, "wave": 20.0})))
    assert decision.probabilities["bump"] < 0.5
    assert (decision.kind, decision.named) == ("unexplained", ())


def test_the_least_sure_name_states_the_evidence(two) -> None:
    sets = posterior_of({"bump wave": 50.0, "bump": 20.0, "wave": 0.0})
    sure = replace(two, posterior=sets)
    assert decide(sure).evidence.log_odds == pytest.approx(30.0, abs=1e-3)
    named = decide(alike(sure, "wave", "twin"))
    assert named.named == ("bump",)
    assert named.evidence.log_odds == pytest.approx(50.0, abs=1e-3)


def test_nothing_is_named_beside_what_stands_in_for_another_law(
    one, quiet, monkeypatch
) -> None:
    monkeypatch.setattr(FitEstimate, "proxies", one.accepted.effects)
    decision = decide(one)
    assert (decision.kind, decision.named) == ("unexplained", ())
    assert decide(quiet).kind == "unexplained"  # though no place shows a gap


@pytest.mark.parametrize(
    ("misfit", "places", "unseen", "kind"),
    [
        (0.5, (), 0.0, "no_gap"),
        (1e-9, (), 0.0, "no_gap"),  # no place shows it
        (1e-9, (PLACE,), 0.0, "unexplained"),
        (1e-9, (), 2.0 * GAP, "unexplained"),
        (0.5, (), 2.0 * GAP, "no_gap"),  # held-out runs alone
    ],
)
def test_a_gap_shows_at_a_place_or_on_held_out_runs(
    quiet, monkeypatch, misfit: float, places, unseen: float, kind: str
) -> None:
    base = replace(quiet.base_fit, misfit=misfit, places=places)
    monkeypatch.setattr(
        "cell.gap.verdict.decision.held_out_gap.bounded_excess", lambda fit: unseen
    )
    assert decide(replace(quiet, base_fit=base)).kind == kind


@pytest.mark.parametrize(
    ("value", "low", "role", "is_end"),
    [
        (5.0, -1.0, "amount", True),
        (-1.0, -1.0, "amount", True),
        (4.9, -1.0, "amount", False),
        (5.0, -1.0, "place", False),
        (0.0, 0.0, "amount", False),  # where it starts
    ],
)
def test_an_amount_at_either_end_is_told_and_a_place_or_a_start_is_not(
    one, value: float, low: float, role: Role, is_end: bool
) -> None:
    fit = one.accepted
    p = Parameter("size", "m", 0.0, low, 5.0, 1e-3, 1.0, role=role)
    effect = replace(fit.effects[0], parameters=(p,))
    point = Point(np.array([*fit.shared[:2], value]), fit.local)
    accepted = replace(fit, model=Model(fit.model.base, (effect,)), point=point)
    ends = decide(replace(one, accepted=accepted)).at_ends
    assert ends == ({"bump": ["size"]} if is_end else {})


def predicted(found: Findings, *left: float | Array) -> DecidedVerdict:
    """Decision where accepted and base predict runs left out alike, and held-out ones
    with residuals `left` instead of 1.
    """
    unseen, base = found.held_out_fits, found.base
    before = replace(unseen.before, residuals=[np.ones(60)] * len(left))
    after = replace(unseen.after, residuals=[n * np.ones(60) for n in left])
    accepted = replace(found.accepted, runs=base.runs, left_out=base.left_out)
    fits = replace(unseen, before=before, after=after)
    return decide(replace(found, accepted=accepted, held_out_fits=fits))


def test_a_prediction_that_fails_in_all_or_in_a_run_or_in_a_quantity_is_told(
    one,
) -> None:
    assert "no better" in predicted(one, 1.0, 1.0).failure
    assert "predicted worse" in predicted(one, 0.0, 1.3).failure
    assert not predicted(one, 0.0, 0.0).failure
    touched, _ = judged(Touched(hidden(bump, 0.05)))
    late = np.append(np.zeros(59), 3.0)
    assert "predicted worse" in predicted(touched, late, late).failure


def test_what_most_runs_leave_counts_and_one_stray_run_does_not(one) -> None:
    usual, unseen = decide(one).evidence, one.held_out_fits
    first, *others = unseen.after.residuals
    stray = first + 50.0 * np.sign(np.sin(np.arange(60)))
    after = replace(unseen.after, residuals=[stray, *others])
    found = decide(replace(one, held_out_fits=replace(unseen, after=after))).evidence
    assert found.left == pytest.approx(usual.left, rel=0.1)
    assert found.correlation == pytest.approx(usual.correlation, abs=0.1)
    residuals = [np.full(60, 3.0)] * len(one.accepted.runs)
    accepted = replace(one.accepted, residuals=residuals)
    every = decide(replace(one, accepted=accepted)).evidence
    assert every.left > 1.5 * usual.left
    assert every.correlation > 0.9


STATED = Parameter("mass", "kg", 0.0, -np.inf, np.inf, 1e-3, 0.01)
EFFECT = Candidate(
    "bump", "", "model", (Parameter("size", "m", 0.0, -5.0, 5.0, 1e-3),), ()
)


def doubted(beside: float, without: float, behind: float, cosine: float) -> Any:
    """Classes of an effect and a base value that lies `beside` it and `without` it so
    many spreads off.

    Without it runs left out are predicted worse by `behind` nats; what it changes is
    like what the value changes by a `cosine`.
    """
    whole, part = Model((STATED,), (EFFECT,)), Model((STATED,))
    turn = np.array([cosine, np.sqrt(1.0 - cosine**2)])
    changes = np.array([[1.0, 0.0], turn])
    accepted: Any = SimpleNamespace(
        model=whole,
        names=whole.names,
        shared=np.array([beside * 0.01, 1.0]),
        changes=changes,
        losses=lambda scale: np.zeros(1),
    )
    plain: Any = SimpleNamespace(
        model=part,
        names=part.names,
        shared=np.array([without * 0.01]),
        losses=lambda scale: np.array([behind]),
    )
    fits = Known((accepted, plain))

    def classes(believed: bool) -> list[list[str]]:
        scope = SimpleNamespace(believed=believed)
        return doubtful_values(accepted, fits, SimpleNamespace(scope=scope))

    return classes


@pytest.mark.parametrize(
    ("beside", "without", "behind", "cosine", "found"),
    [
        (9.0, 0.0, 50.0, 0.95, True),  # changes what a strained value changes
        (9.0, 0.0, 50.0, 0.85, False),
        (3.9, 0.0, 50.0, 0.95, False),
        (0.0, 9.0, 3.9, 0.0, True),  # predicts no better than a strained value
        (0.0, 9.0, 4.1, 0.0, False),
        (0.0, 3.9, 3.9, 0.0, False),
    ],
)
def test_a_wrong_file_shares_a_class_with_what_looks_like_it(
    beside, without, behind, cosine, found: bool
) -> None:
    classes = doubted(beside, without, behind, cosine)
    assert classes(True) == ([["bump", "mass"]] if found else [])
    assert classes(False) == []


def test_an_interval_holds_95_of_100_of_what_the_estimate_may_be(one) -> None:
    fit = one.model_tests.sized
    (own,) = intervals(fit, 1.0, ())["bump"].values()
    (wide,) = intervals(fit, 4.0, ())["bump"].values()
    sigma = np.sqrt(np.linalg.inv(fit.normal().curvature)[2, 2])
    share = np.diff(stats.norm.cdf([own.low, own.high], own.value, sigma))
    assert share == pytest.approx(0.95, abs=0.005)
    assert wide.high - wide.low == pytest.approx(2.0 * (own.high - own.low), rel=0.02)
