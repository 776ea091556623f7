"""What differs from run to run, and what all runs get wrong alike: claims count
both.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from cell.gap.fitting.reml import (
    SMALLEST,
    Likelihood,
    covariance,
    degrees_of_freedom,
    reml_spreads,
)
from cell.gap.subject.subject import Residuals, SimulationRequest
from cell.gap.verdict.compose import intervals
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter
from tests.support.curves import Curves, Law, T, bump, fitted, hidden, judged, nothing

USUAL = 0.1
SLOPE, SIGMA = 0.5, 0.2  # m/s, of the curves and of a common error that grows with time


class Scattering(Curves):
    """Curves each of which holds a wave of its own, of a size drawn anew in each
    run.
    """

    def __init__(
        self, law: Law, spread: float, seed: int = 0, noise: float = 0.01
    ) -> None:
        self.drawn = drawn = np.random.default_rng([seed, 5]).normal(0.0, spread, 99)
        super().__init__(
            lambda t, s, i: law(t, s, i) + drawn[i] * ripple(t),
            noise=noise,
            seed=seed,
            repeats=3,
        )
        own = Parameter(
            "ripple", "m", 0.0, -1.0, 1.0, 1e-3, USUAL, random=True, common=True
        )
        self.runs[:] = [replace(run, local=(*run.local, own)) for run in self.runs]

    def simulate(self, requests: Sequence[SimulationRequest]) -> list[Residuals]:
        found = super().simulate(requests)
        for q, residuals in zip(requests, found, strict=True):
            own = [v for p, v in zip(q.run.local, q.local, strict=True) if p.random]
            residuals.mean[:] -= sum(own) * ripple(T)
        return found


def ripple(t: np.ndarray) -> np.ndarray:
    return np.cos(13.0 * t)


@pytest.mark.parametrize("true", [0.05, 0.2])
def test_spread_is_estimated_within_its_interval(true: float) -> None:
    subject = Scattering(nothing, true)
    (found,) = reml_spreads(fitted(subject))
    drawn = np.std(subject.drawn[: len(subject.runs)], ddof=1)
    assert found.value == pytest.approx(drawn, rel=0.3)
    assert found.low < true < found.high


def test_slope_of_the_restricted_likelihood_is_its_change() -> None:
    fit = fitted(Scattering(nothing, USUAL))
    likelihood = Likelihood.of(fit, {"ripple": fit.runs[0].local[-1]})

    def loss(logs: Array) -> tuple[float, Array]:
        return likelihood.loss(np.exp(logs), [0])

    logs = np.array([-1.0])
    (change,) = approx_fprime(logs, lambda x: loss(x)[0], 1e-6)
    assert loss(logs)[1] == pytest.approx(change, rel=1e-3)


def test_what_the_runs_refute_is_switched_off_as_is_what_all_of_them_hold() -> None:
    constant: Law = lambda t, s, i: 0.3 * ripple(t)  # noqa: E731
    for law in (nothing, constant):
        assert not reml_spreads(fitted(Scattering(law, 0.0)))


def test_a_spread_that_coarse_runs_cannot_exclude_is_kept_small() -> None:
    (found,) = reml_spreads(fitted(Scattering(nothing, 0.0, seed=2, noise=2.0 * USUAL)))
    assert SMALLEST * USUAL <= found.value < 0.2 * USUAL


def test_scatter_alone_is_no_gap() -> None:
    for seed in range(4):
        _, verdict = judged(Scattering(nothing, 0.2, seed=seed))
        assert verdict.verdict == "no_gap"


def test_an_effect_is_named_beside_scatter_with_its_true_size_within_the_interval():
    found, verdict = judged(Scattering(hidden(bump, 0.1), 0.2))
    assert [e.name for e in verdict.effects] == ["bump"]
    size = verdict.effects[0].parameters["size"]
    assert size.low < 0.1 < size.high
    assert [s.name for s in found.model_tests.scatter] == ["ripple"]


def test_what_is_detectable_counts_the_scatter() -> None:
    still, scattered = (
        judged(Scattering(nothing, s))[1].detectable["wave"] for s in (0.0, 0.2)
    )
    assert scattered >= still


def biased(seed: int, *, told: bool) -> Curves:
    """Curves whose instrument errs by the same slope in every run, and says so or
    not.
    """
    error = SIGMA * float(np.random.default_rng([seed, 5]).standard_normal())
    subject = Curves(lambda t, _, __: error * t, seed=seed)
    return telling(subject) if told else subject


def telling(subject: Curves) -> Curves:
    """The same, with what is known of its instrument."""
    subject.runs = [replace(run, common={"gain": SIGMA * T}) for run in subject.runs]
    return subject


def holds(subject: Curves) -> bool:
    slope = intervals(fitted(subject), 1.0, ())["base"]["slope"]
    return slope.low < SLOPE < slope.high


def test_interval_holds_the_truth_where_all_runs_err_alike() -> None:
    assert sum(holds(biased(seed, told=True)) for seed in range(20)) >= 18
    assert sum(holds(biased(seed, told=False)) for seed in range(20)) <= 10


def test_common_error_does_not_average_out_over_runs() -> None:
    for repeats in (1, 4):
        fit = fitted(telling(Curves(nothing, repeats=repeats)))
        width = np.sqrt(covariance(fit, 1.0)[1, 1])
        assert width == pytest.approx(SIGMA, rel=0.05)


def test_variances_without_error_have_the_most_degrees_of_freedom() -> None:
    assert degrees_of_freedom(fitted(Curves(nothing)), 1e12, ()) == pytest.approx(1e6)
