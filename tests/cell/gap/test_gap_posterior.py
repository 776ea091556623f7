"""Which sets of effects are probable, and what is stated of a name."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from cell.gap.fitting import run_all
from cell.gap.fitting.base_fit import projection
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.model import Model
from cell.gap.selection.likelihood import Fits, LikelihoodScale
from cell.gap.selection.posterior import (
    Beliefs,
    Posterior,
    SetProbability,
    _SharedTerms,
    floor_responses,
    posterior,
    shared_causes,
)
from cell.gap.selection.screening import (
    ProbeResponses,
    detection_limits,
    probe_equations,
    ranked_pairs,
    run_probes,
)
from cell.gap.subject.subject import Candidate
from cell.gap.verdict.confidence import calibration
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter
from tests.support.curves import Curves, both, bump, fitted, hidden, judged, validated

PLAIN = LikelihoodScale(1.0, 1.0)
EXACT = Beliefs.shipped().model_copy(update={"immaterial": 0.0, "shares": (0.0,)})


def sets(subject: Curves, *names: tuple[str, ...], prior: Beliefs = EXACT) -> Posterior:
    models = tuple(validated(fitted(subject, n), subject) for n in ((), *names))
    base = models[0]
    probed = screened(subject, base)
    return posterior(
        Fits(models, floor_responses(base, probed, believed=False)), PLAIN, prior
    )


def screened(subject: Curves, base: FitEstimate) -> list[ProbeResponses]:
    """Responses at `base` to every effect of the library."""
    tasks = [run_probes(base, c) for c in subject.scope.candidates]
    return run_all(subject.simulate, tasks)


def at_prior_mean(
    subject: Curves, names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Residual (N,), Jacobian (N, size) and prior spreads (size,) of a model that is
    linear.
    """
    fit = fitted(subject, names)
    every, jacobian = fit.unknowns.parameters, fit.stacked_jacobian
    away = jacobian @ (np.array([p.start for p in every]) - fit.z)
    return fit.stacked_residuals + away, jacobian, np.array([p.spread for p in every])


def density(subject: Curves, names: tuple[str, ...]) -> float:
    """Log density of the runs under a linear model with normal priors."""
    r, jacobian, spread = at_prior_mean(subject, names)
    return stats.multivariate_normal(cov=covariance(jacobian, spread)).logpdf(r)


def covariance(jacobian: Array, spread: Array) -> Array:
    """Covariance (N, N) of residuals with unit noise and priors of `spread` (size,)."""
    return np.eye(len(jacobian)) + (jacobian * spread**2) @ jacobian.T


def nats(found: Posterior, *names: str) -> float:
    return next(m.nats for m in found.models if m.names == frozenset(names))


def test_evidence_of_a_linear_model_is_the_density_of_its_runs() -> None:
    subject = Curves(hidden(bump, 0.008), repeats=1, seed=1)
    found, chance = sets(subject, ("bump",)), np.log((1 / 3) / (2 / 3))
    exact = density(subject, ("bump",)) - density(subject, ()) + chance
    assert nats(found, "bump") - nats(found) == pytest.approx(exact, abs=0.01)
    assert sum(m.p for m in found.models) == pytest.approx(1.0)
    assert found.log_odds(lambda names: "bump" in names) == pytest.approx(
        exact, abs=0.01
    )


@pytest.mark.parametrize("size", [0.003, -0.003])
def test_an_effect_of_one_sign_is_integrated_over_that_sign(size: float) -> None:
    subject = Curves(hidden(bump, size), repeats=1, seed=1, signed=False)
    r, jacobian, spread = at_prior_mean(subject, ("bump",))
    own, spread[2] = jacobian[:, 2], 0.0
    around = stats.multivariate_normal(cov=covariance(jacobian, spread))

    def likely(a: float) -> float:
        return stats.norm.pdf(a) * np.exp(around.logpdf(r + own * a) - around.logpdf(r))

    share, _ = integrate.quad(likely, 0.0, 0.03)
    found = sets(subject, ("bump",))
    assert nats(found, "bump") - nats(found) == pytest.approx(np.log(share), abs=0.02)


def test_twins_share_what_one_of_them_has() -> None:
    subject = Curves(hidden(bump, 0.05), names=("bump", "twin", "wave"))
    found = sets(subject, ("bump",), ("twin",), ("wave",))
    even = {"bump": 0.5, "twin": 0.5, "wave": 0.0}
    assert found.inclusion == pytest.approx(even, abs=0.01)
    assert found.log_odds(lambda names: bool(names & {"bump", "twin"})) > 100.0


@pytest.mark.parametrize(("camera", "change", "sure"), [(0.0046, 1.0, False),
    (-0.0047, 1.0, False), (0.008, 1.0, True), (0.008, -0.9, False)])  # fmt: skip
def test_two_that_one_cause_may_make(camera: float, change: float, sure: bool) -> None:
    x = Parameter("x", "m", 0.0, -0.03, 0.03, step=1e-4)
    two = tuple(Candidate(name, "", "cell", (x,), ()) for name in ("camera", "tool"))
    model, values = Model((), two), np.array([camera, -0.0046])
    fit = SimpleNamespace(model=model, effects=two, values=model.split(values))
    fit.changes = np.array([[change], [1.0]])
    both = SetProbability(model.names, 0.0, 1.0, shared_causes(fit, -3.0))
    tool = SetProbability(frozenset({"tool"}), -30.0, 0.0)
    log_odds = Posterior((both, tool)).log_odds(lambda names: "camera" in names)
    assert (log_odds > 20.0) if sure else (log_odds < -5.0)


def test_one_cause_of_two_effects_says_nothing_of_a_third() -> None:
    three = SetProbability(frozenset("abc"), 0.0, 1.0, [(frozenset("ab"), 9.0)])
    log_odds = Posterior((three, SetProbability(frozenset(), -5.0, 0.0))).log_odds
    assert log_odds(lambda names: "c" in names) == pytest.approx(5.0)


def test_what_the_floor_allows_is_no_effect() -> None:
    """An amount that the model's own error can make speaks for no effect."""
    subject = Curves(hidden(bump, 0.006), repeats=1, seed=1)
    for run in subject.runs:
        run.samples.floor[:] = 0.02
    exact = sets(subject, ("bump",))
    wary = sets(subject, ("bump",), prior=EXACT.model_copy(update={"immaterial": 0.5}))
    assert wary.inclusion["bump"] < exact.inclusion["bump"]


def test_a_law_that_may_be_wrong_is_no_evidence_by_itself(monkeypatch) -> None:
    monkeypatch.setattr(_SharedTerms, "_evidence_at", lambda *_: 3.0)
    known: Any = SimpleNamespace(effects=["one"])
    terms: Any = _SharedTerms(known, np.ones(1), {}, Beliefs.shipped())
    assert terms.evidence(known) == pytest.approx(3.0)


def test_a_law_that_may_be_wrong_leaves_room_for_what_it_leaves() -> None:
    """A rival that only mends what a nearly true law gets wrong loses its lead."""
    subject = Curves(lambda t, s, i: 0.3 * bump(t - 0.01, s, i), repeats=1, seed=1)
    sure = sets(subject, ("bump",), ("bump", "wave"))
    prior = Beliefs.shipped().model_copy(update={"immaterial": 0.0})
    wary = sets(subject, ("bump",), ("bump", "wave"), prior=prior)
    lead = [nats(f, "bump", "wave") - nats(f, "bump") for f in (sure, wary)]
    assert lead[1] < 0.5 * lead[0]


def test_a_verdict_states_what_its_signs_are_worth() -> None:
    steep = lambda t, s, i: 0.05 * bump(t, s, i) - 1.5 * t  # noqa: E731
    _, verdict = judged(Curves(steep))
    (effect,), found = verdict.effects, verdict.posterior
    assert found.strain == pytest.approx(1.0, abs=0.05)  # of a slope of -1
    assert found.models[0].names == ["bump"]
    assert sum(m.p for m in found.models) == pytest.approx(1.0)
    assert effect.confidence == calibration("mechanism").probability(found)
    assert found.left == pytest.approx(1.0, abs=0.2)
    assert abs(found.correlation) < 0.3


def test_the_pair_that_is_there_is_fitted_first() -> None:
    subject = Curves(both(0.2, -0.1), names=("bump", "twin", "wave"))
    base = fitted(subject)
    equations = probe_equations(projection(base), screened(subject, base))
    (pair,) = ranked_pairs(equations, among=1)
    assert pair.names == ("bump", "wave")


def test_what_would_show_is_stated_in_the_unit_of_the_main_parameter() -> None:
    pair = tuple(Parameter(of, of, 0.0, 0.0, 9.0, step=1.0) for of in ("N m", "1"))
    candidate, steps = Candidate("e", "", "model", pair, ()), tuple(np.eye(2)[::-1])
    seen = ProbeResponses(candidate, (steps,), (np.diag([8.0, 4.0]),))
    bare = SimpleNamespace(
        weigh=lambda r: r, form=lambda r: SimpleNamespace(curvature=r @ r.T)
    )
    assert detection_limits(bare, [seen], PLAIN) == {"e": 2.0}
