"""Composes the verdict document from the findings of an investigation."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import islice

import numpy as np
from scipy import special

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.reml import Spread, covariance, degrees_of_freedom
from cell.gap.selection.likelihood import family_wise, likelihood_ratio_p, margin
from cell.gap.subject.subject import Candidate, Parameter
from cell.gap.verdict.decision import (
    GAP,
    decide,
    deciding_numbers,
    describe_left,
    named_effects,
    probability,
    unseen_gap,
)
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import (
    CandidateEntry,
    Deviation,
    Gap,
    Interval,
    Kind,
    NamedEffect,
    Probable,
    ProbableSet,
    Recommendation,
    Unexplained,
    ValueWithUnit,
    Verdict,
    WhereBin,
)

# Limits of what a verdict lists, set by hand.
SIGNIFICANT = 0.05  # family-wise p-value below which a place is listed; customary
MOST_PLACES, MOST_SETS = 24, 20
LEAST_SEPARATION = 1.0  # sigma, of an experiment
TOLERATED = 2.0  # prior standard deviations from a value without a stated range, 95 %
HUGE = 1e12  # stands for an infinite value, which JSON cannot hold


def verdict(findings: Findings, runtime: float, simulations: int) -> Verdict:
    """Verdict document of an investigation, from its findings."""
    verdict_kind = decide(findings)
    tests = findings.model_tests
    values = intervals(tests.sized, findings.likelihood.inefficiency, tests.scatter)
    named = [e.name for e in named_effects(findings)]
    effects = [
        NamedEffect(
            name=e.name,
            of=e.of,
            parameters=_values_by_parameter(e, values[e.name]),
            confidence=probability(findings, e.name),
        )
        for e in findings.separable
    ]
    return Verdict(
        verdict=verdict_kind,
        effects=[e for e in effects if e.name in named],
        ambiguous=[] if verdict_kind == "no_gap" else list(map(list, tests.classes)),
        unexplained=_unexplained(findings, verdict_kind),
        base={
            p.name: Interval(value=v.value, low=v.low, high=v.high)
            for p, v in zip(findings.subject.scope.base, values["base"], strict=True)
        },
        where=_where(findings),
        gap=_gap(findings),
        candidates=_candidates(findings),
        advice=_advice(findings),
        detectable={k: v for k, v in findings.screen.detectable.items() if v is not None},
        held_out=list(findings.held_out),
        runtime=runtime,
        simulations=simulations,
        posterior=_posterior(findings),
        suspected=[e for e in effects if e.name not in named and verdict_kind != "no_gap"],
        notes=_notes(findings, verdict_kind),
    )


def intervals(
    estimate: Estimate, inefficiency: float, scatter: Sequence[Spread]
) -> dict[str, list[ValueWithUnit]]:
    """95 % intervals of the base's parameters (`base`) and of each effect's, in their order.

    They cover noise, run-to-run scatter and measurement errors common to all runs; they are wider
    where few runs show how large the scatter is.
    """
    spread = np.sqrt(np.diag(covariance(estimate, inefficiency)))
    reach = special.stdtrit(degrees_of_freedom(estimate, inefficiency, scatter), 0.975)
    model = estimate.model
    owners = ["base"] * len(model.base)
    owners += [e.name for e in model.effects for _ in e.parameters]
    by_owner: dict[str, list[ValueWithUnit]] = {name: [] for name in ("base", *owners)}
    rows = zip(owners, model.parameters, estimate.shared, reach * spread, strict=False)
    for owner, parameter, value, half in rows:
        by_owner[owner].append(_interval(parameter, float(value), float(half)))
    return by_owner


def _interval(p: Parameter, value: float, half: float) -> ValueWithUnit:
    ends = [max(p.low, value - half), min(p.high, value + half)]
    stated = sorted(p.stated_value(v) for v in ends)
    low, high = (v if np.isfinite(v) else None for v in stated)
    middle = p.stated_value(value)
    return ValueWithUnit(
        value=middle if np.isfinite(middle) else HUGE, low=low, high=high, unit=p.unit
    )


def _values_by_parameter(
    candidate: Candidate, values: list[ValueWithUnit]
) -> dict[str, ValueWithUnit]:
    return {p.name: v for p, v in zip(candidate.parameters, values, strict=True)}


def _where(findings: Findings) -> list[WhereBin]:
    significant = (place for place in findings.places if place.p < SIGNIFICANT)
    return [WhereBin(**asdict(place)) for place in islice(significant, MOST_PLACES)]


def _gap(findings: Findings) -> Gap:
    held_out, quantities = findings.unseen, findings.subject.scope.quantities
    return Gap(
        before=held_out_gap.sizes(held_out.before, quantities),
        after=held_out_gap.sizes(held_out.after, quantities),
        floor={**held_out_gap.floor(held_out.before.evidence, quantities), "excess": 0.0},
        shrink=held_out.shrink.value,
        shrink_low=held_out.shrink.low,
        shrink_high=held_out.shrink.high,
    )


def _unexplained(findings: Findings, which: Kind) -> Unexplained | None:
    """Description of an unexplained gap, or of what named effects leave; None if nothing."""
    if which == "no_gap" or not (which == "unexplained" or findings.model_tests.remains):
        return None
    law = findings.law.words if findings.law is not None else "no sparse law found"
    return Unexplained(
        description=describe_left(findings), law=law, stable=findings.law is not None
    )


def _posterior(findings: Findings) -> Probable:
    """Posterior part of a verdict, with the numbers that decide on it."""
    deciding = deciding_numbers(findings)
    return Probable(
        models=[
            ProbableSet(names=sorted(m.names), p=m.p) for m in findings.posterior.models[:MOST_SETS]
        ],
        inclusion=findings.posterior.inclusion,
        left=deciding.left,
        correlation=deciding.correlation,
        log_odds=deciding.log_odds if np.isfinite(deciding.log_odds) else None,
        ahead=deciding.gain,
        worst=deciding.worst,
        strain=deciding.strain,
        law=findings.law is not None,
    )


def _candidates(findings: Findings) -> list[CandidateEntry]:
    """Candidates by their gain, the best first: refitted models, and others as screened."""
    fits = findings.choice.fits
    base, others = fits.base, [m for m in fits.models if m.model.effects]
    singles = [m for m in others if len(m.model.effects) == 1]
    family = _family(findings, base, singles)
    rows = [_compare_with_base(findings, base, m, family) for m in others]
    refitted = {m.model.name for m in singles}
    gains = {p.candidate.name: 0.0 for p in findings.screen.probed}
    gains |= {score.names[0]: score.gain for score in findings.screen.singles}
    rows += [
        _compare_by_screen(findings, name, gain)
        for name, gain in gains.items()
        if name not in refitted
    ]
    return sorted(rows, key=lambda row: -row.elpd_gain)


def _family(
    findings: Findings, base: CrossValidatedFit, singles: list[CrossValidatedFit]
) -> dict[str, float]:
    """Family-wise p-values of single candidates over the whole library."""
    raw = {m.model.name: likelihood_ratio_p(m, base, findings.likelihood) for m in singles}
    return family_wise(raw, [c.name for c in findings.subject.scope.candidates])


def _compare_with_base(
    findings: Findings, base: CrossValidatedFit, model: CrossValidatedFit, family: dict[str, float]
) -> CandidateEntry:
    likelihood = findings.likelihood
    ahead = margin(model, base, likelihood)
    values = intervals(model.estimate, likelihood.inefficiency, findings.model_tests.scatter)
    several = len(model.model.effects) > 1
    p = family[model.model.name] if not several else likelihood_ratio_p(model, base, likelihood)
    parameters = {}
    for e in model.model.effects:
        for name, value in _values_by_parameter(e, values[e.name]).items():
            parameters[f"{e.name}.{name}" if several else name] = value
    return CandidateEntry(
        name=model.model.name,
        elpd_gain=ahead.gain,
        se=ahead.se,
        p=p,
        parameters=parameters,
    )


def _compare_by_screen(findings: Findings, name: str, gain: float) -> CandidateEntry:
    """Row of a candidate that was not refitted, with its gain in the linear screen."""
    score = next((s for s in findings.screen.singles if s.names == (name,)), None)
    candidate = next(c for c in findings.subject.scope.candidates if c.name == name)
    values = score.start.get(name, candidate.null) if score is not None else candidate.null
    parameters = {}
    for p, v in zip(candidate.parameters, values, strict=True):
        value = p.stated_value(float(v))
        if np.isfinite(value):
            parameters[p.name] = ValueWithUnit(value=value, low=None, high=None, unit=p.unit)
    return CandidateEntry(
        name=name,
        elpd_gain=gain / findings.likelihood.inefficiency,
        se=0.0,
        p=findings.screen.p.get(name, 1.0),
        parameters=parameters,
    )


def _advice(findings: Findings) -> list[Recommendation]:
    return [
        Recommendation(
            experiment=f"{a.experiment.name}: {a.experiment.instruction}",
            separates=a.separates,
            expected_sigma=a.sigma,
            minutes=a.experiment.minutes,
        )
        for a in findings.advice.experiments
        if a.sigma >= LEAST_SEPARATION
    ]


def _notes(findings: Findings, which: Kind) -> list[str]:
    """Note that held-out runs show a gap where the fitted ones show none; else nothing."""
    if which != "no_gap" or (gap := unseen_gap(findings)) <= GAP:
        return []
    return [
        f"held-out runs ({', '.join(findings.held_out)}) leave {np.hypot(1.0, gap):.2g} times "
        "their noise, which the fitted runs do not: make these motions again, and fit all runs"
    ]


def deviations(base: Sequence[Parameter], fitted: Mapping[str, Interval]) -> list[Deviation]:
    """Values of `fitted` whose whole 95 % interval lies outside what the file tolerates."""
    rows = []
    for p in base:
        value = fitted.get(p.name)
        if value is None:
            continue
        low, high = _range_of(p)
        above = value.low is not None and value.low > high
        below = value.high is not None and value.high < low
        if above or below:
            rows.append(
                Deviation(
                    parameter=p.name,
                    stated=p.stated_value(p.start),
                    tolerated=(low, high if np.isfinite(high) else None),
                    unit=p.unit,
                    **value.model_dump(include={"value", "low", "high"}),
                )
            )
    return rows


def _range_of(p: Parameter) -> tuple[float, float]:
    """Range of a parameter that the file tolerates, as files state the value."""
    if p.tolerated is not None:
        return p.tolerated
    reach = TOLERATED * p.spread
    ends = p.stated_value(max(p.start - reach, p.low)), p.stated_value(p.start + reach)
    return min(ends), max(ends)
