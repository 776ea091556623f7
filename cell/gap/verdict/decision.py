"""Decides a verdict from four kinds of evidence, and says why.

1. `log_odds`: the posterior's, that an accepted effect is present, or one that the runs
   do not separate from it. One covariance holds noise, floor, what differs from run to
   run, errors of laws, and immaterial amounts of absent effects
   (`selection.posterior`).
2. `gain` and `worst`: how much better runs are predicted to which nothing was fitted:
   conditions left out in turn, and held-out runs; in all, and in the run or quantity
   that gains least.
3. `left` and `correlation`: what no law accounts for in most runs, fitted and held-out.
4. `strain`: how far the accepted effects carry the base from what the file states.

The probability that a name is right is a calibrated function of them, and nothing that
counts in it is a veto beside it. An effect is named where that is LEAST or more, and
its amounts lie inside the ranges that are tried. What is named need not account for
all: what is left is described beside it. An effect whose own response is that of a
strained base, or that predicts runs no better than one, is in one class with a wrong
file.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting import robust
from cell.gap.fitting.base_fit import strains
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, Fits, gain
from cell.gap.subject.subject import Origin, Subject
from cell.gap.verdict.confidence import LEAST, calibration
from cell.gap.verdict.findings import DecidedVerdict, Findings, FitResults
from cell.gap.verdict.schema import Kind, Step, Verdict, VerdictEvidence
from cell.report.words import plain
from drivers.base.errors import in_percent
from drivers.base.types import Array

# excess on held-out runs, in units of the noise, that is a gap by itself; set by hand
GAP = 0.5
STRAINED = 4.0  # prior standard deviations: right names strain a base by 0.7 at most
# times the median run's residual, above which a run is an outlier; set by hand
ASTRAY = 2.0
ALIKE = 0.9  # cosine of two responses above which one cannot be told from the other
OFFERED = 0.2  # probability from which a suspect may be accepted all the same


def decide(results: FitResults) -> DecidedVerdict:
    """Decide which verdict the fitted models support: a named effect, several that
    cannot be told apart, an unexplained residual, or no gap.
    """
    common = _common_evidence(results)
    evidence = _evidence_by_effect(results, common)
    probability = calibration(results.subject.kind).probability
    probabilities = {name: probability(found) for name, found in evidence.items()}
    ends = _amounts_at_ends(results)

    credible = _credible_effects(results, probabilities, ends)
    sure = {effect.name for effect in results.separable}
    named = tuple(name for name in credible if name in sure)
    deciding = [evidence[name] for name in named or evidence]

    return DecidedVerdict(
        kind=_kind(results, is_credible=bool(credible), is_named=bool(named)),
        named=named,
        probabilities=probabilities,
        evidence=min(deciding, key=lambda found: found.log_odds, default=common),
        failure=_failed_prediction(common) if evidence else "",
        at_ends=ends,
        unseen_gap=unseen_gap(results),
    )


def _kind(results: FitResults, *, is_credible: bool, is_named: bool) -> Kind:
    """Kind of verdict: "named" or "ambiguous" where an accepted effect is credible,
    else "unexplained" or "no_gap".
    """
    if is_credible:
        return "named" if is_named else "ambiguous"
    stands_in = bool(results.accepted.proxies)
    return "unexplained" if stands_in or _gap_is_there(results) else "no_gap"


def _credible_effects(
    results: FitResults,
    probabilities: Mapping[str, float],
    ends: Mapping[str, Sequence[str]],
) -> list[str]:
    """Names of the accepted effects whose probability is high enough and of which no
    amount lies at an end of the range that is tried, as `ends` lists.

    None beside one that stands in for another law: what that law is may change the
    others.
    """
    if results.accepted.proxies:
        return []
    probable = [name for name, p in probabilities.items() if p >= LEAST]
    return [name for name in probable if name not in ends]


def _amounts_at_ends(results: FitResults) -> dict[str, list[str]]:
    """Names of the parameters that lie at an end of the range that is tried, by the
    name of the accepted effect that they belong to.

    Places may lie at an end, as that of a strip.
    """
    fit = results.accepted
    _, values = fit.values
    ends = {
        effect.name: [
            p.name
            for p, value in zip(effect.parameters, values[effect.name], strict=True)
            if p.is_amount and value in (p.low, p.high) and value != p.start
        ]
        for effect in fit.effects
    }
    return {name: amounts for name, amounts in ends.items() if amounts}


def _failed_prediction(evidence: VerdictEvidence) -> str:
    """Clause that says that the accepted model predicts unseen runs no better than the
    model without effects; empty where it predicts them better.
    """
    if evidence.gain <= 0.0:
        return "runs that the fit has not seen are predicted no better"
    if evidence.worst <= -MIN_GAIN:
        return "a run or a quantity that the fit has not seen is predicted worse"
    return ""


def _gap_is_there(results: FitResults) -> bool:
    """Whether the refitted file leaves more than noise, in some group of samples or on
    held-out runs.

    A misfit as a whole that no place shows, and no run that was held out, is no gap.
    """
    if not results.base_fit.gap:
        return False
    shows = any(place.p < ALPHA for place in results.base_fit.places)
    return shows or unseen_gap(results) > GAP


def unseen_gap(results: FitResults) -> float:
    """Root mean square by which residuals of held-out runs exceed their noise, in units
    of noise, with the refitted file, no effect, and outliers clipped.
    """
    return held_out_gap.bounded_excess(results.held_out_fits.before)


def _evidence_by_effect(
    results: FitResults, common: VerdictEvidence
) -> dict[str, VerdictEvidence]:
    """Evidence that sets the probability of each accepted effect, by its name: the
    `common` evidence with the log-odds of that effect, or of those that runs cannot
    tell from it.
    """
    return {
        effect.name: common.model_copy(
            update={"log_odds": _log_odds(results, effect.name)}
        )
        for effect in results.accepted.effects
    }


def _log_odds(results: FitResults, effect: str) -> float:
    """Logarithm [nats] of the posterior odds that `effect`, or one that the runs cannot
    tell apart from it, is present.
    """
    classes = [group for group in results.model_tests.classes if effect in group]
    alike = {effect}.union(*classes)
    return results.posterior.log_odds(lambda names: not alike.isdisjoint(names))


def _common_evidence(results: FitResults) -> VerdictEvidence:
    """Evidence for or against the accepted model as a whole, in which the log-odds of
    an effect are still infinite.
    """
    runs, quantities = _gains(results)
    accepted = results.accepted
    fits = (accepted, results.held_out_fits.after)
    by_run = [held_out_gap.rms_by_run(fit, results.quantities) for fit in fits]
    typical_rms = float(np.median([rms for of_fit in by_run for rms in of_fit]))
    return VerdictEvidence(
        gain=sum(runs),
        worst=min([*runs, *quantities]),
        left=typical_rms,
        correlation=max(
            _correlation(fit, [rms <= ASTRAY * typical_rms for rms in of_fit])
            for fit, of_fit in zip(fits, by_run, strict=True)
        ),
        strain=max(map(abs, strains(accepted).values()), default=0.0),
    )


def _correlation(fit: FitEstimate, together: Sequence[bool]) -> float:
    """Correlation between successive residuals, over those runs of `fit` that are
    marked true in `together`.
    """
    typical = fit.on([i for i, shares in enumerate(together) if shares])
    return robust.correlation(typical.runs, typical.residuals)


def _gains(results: FitResults) -> tuple[list[float], list[float]]:
    """How much better [nats] the accepted model predicts unseen data than the model
    without effects: one number for each run, and one for each measured quantity.

    It is of runs left out in turn as predicted from the others, and of held-out ones.
    """
    likelihood = results.likelihood
    unseen = results.held_out_fits
    left_out = [(fit, fit.left_out) for fit in (results.base, results.accepted)]
    held_out = [(fit, fit.residuals) for fit in (unseen.before, unseen.after)]
    by_run: list[float] = []
    by_quantity: dict[str, float] = defaultdict(float)
    for (before, r_base), (after, r_accepted) in (left_out, held_out):
        rows = zip(before.runs, after.runs, r_base, r_accepted, strict=True)
        for run_before, run_after, r_before, r_after in rows:
            quantity = run_before.samples.quantity
            scale = run_before.samples.scale
            scale_after = run_after.samples.scale
            unit = np.maximum(scale, scale_after) * likelihood.scale
            loss = robust.bounded_loss(r_before * scale / unit)
            gain = loss - robust.bounded_loss(r_after * scale_after / unit)
            gain /= likelihood.inefficiency
            by_run.append(gain.sum())
            for name in np.unique(quantity):
                by_quantity[str(name)] += gain[quantity == name].sum()

    return by_run, [*by_quantity.values()]


def next_steps(
    decision: DecidedVerdict, verdict: Verdict, out: Path, origin: Origin
) -> list[Step]:
    """What an operator may do after the `verdict`, such as accepting its patch or
    folding again, the advised step first.

    `out` is the folder of the fit, `origin` states the subject. A fit leaves a patch
    for each step that accepts something.
    """
    if (changed := origin.changed()) is not None:
        words = f"{changed} has changed while it was fitted: fit again"
        return [Step("repeat", "", words)]
    folder = quote(str(out))
    fit = f"{folder} {origin.option}"
    accept = f"cell gap accept {fit}"
    undo = f"`cell gap undo {fit}` takes it back"
    rest = verdict.unexplained
    suspected = verdict.suspected
    law = rest.law if rest and rest.stable else ""
    steps = []

    if verdict.effects:
        fold = _fold_command(origin.option)
        then = f"; then `{fold}` folds with it" if fold else ""
        words = f"puts what was named into the file{then}; {undo}"
        steps.append(Step("accept", accept, words))
    elif verdict.deviates and not decision.probabilities:
        words = (
            f"puts the refitted values into the file; {undo}. If these runs are of"
            " another subject, name its file instead"
        )
        steps.append(Step("accept_values", accept, words))

    if decision.kind == "ambiguous":
        words = "says which run would split what is alike"
        steps.append(Step("advise", f"cell gap advise {folder}", words))
    if decision.kind == "unexplained" and (suspected or not law):
        words = f"{out / 'report.html'} shows where it sits, and what stands beside it"
        steps.append(Step("look", "", words))

    if suspected and not verdict.effects and _may_be_forced(decision, verdict):
        names = " + ".join(effect.name for effect in suspected)
        least = min(effect.confidence for effect in suspected)
        probable = f"{in_percent(least)} probable"
        words = f"takes all the same what is suspected, not named: {names}, {probable}"
        steps.append(Step("accept_suspected", f"{accept} --force", words))
    if law:
        words = f"adds a description, no name: {law}; {undo}"
        steps.append(Step("accept_law", f"{accept} --law", words))

    return steps or [_step_without_gap(decision, origin.option)]


def _may_be_forced(decision: DecidedVerdict, verdict: Verdict) -> bool:
    """Whether every suspected effect is probable enough to be accepted on demand, and
    lies inside the range that is tried.
    """
    return all(
        effect.confidence >= OFFERED and effect.name not in decision.at_ends
        for effect in verdict.suspected
    )


def _fold_command(option: str) -> str:
    """Command line that folds the strip which the command-line `option` names; empty
    where it names a mechanism.
    """
    return f"cell fold {option}" if option.startswith("--strip") else ""


def _step_without_gap(decision: DecidedVerdict, option: str) -> Step:
    """Advised step after fitted runs that show no gap, where there is nothing to
    accept; `option` is the command-line option of the subject.
    """
    if decision.unseen_gap > GAP:
        words = "make the motions of the held-out runs again, and fit all runs"
        return Step("repeat", "", words)
    if fold := _fold_command(option):
        words = "folds with the file as it is: there is nothing to accept"
        return Step("fold", fold, words)
    return Step("none", "", "these runs show no gap: there is nothing to accept")


def doubtful_values(
    accepted: CrossValidatedFit, fits: Fits, subject: Subject
) -> list[list[str]]:
    """Groups of names, each of an `accepted` effect and of values in the file of the
    strip or mechanism, one of which may be wrong in place of the other.

    Either those values lie STRAINED standard deviations off or more without the effect,
    and runs left out are then predicted as well; or they do beside it, and what that
    changes is what the effect changes.
    """
    if not subject.scope.believed:
        return []

    groups: list[list[str]] = []
    refuted = _strained(accepted)
    base, by_effect = accepted.model.split(accepted.changes)
    strained = base[[p.name in refuted for p in accepted.model.base]].sum(axis=0)

    for name, rows in by_effect.items():
        if abs(_cosine(rows.sum(axis=0), strained)) > ALIKE:
            groups.append([name, *refuted])
        without = fits.of(accepted.names - {name})
        if without and gain(accepted, without, fits.likelihood) < MIN_GAIN:
            groups.append([name, *_strained(without)])

    return [group for group in groups if len(group) > 1]


def _strained(fit: FitEstimate) -> list[str]:
    """Names of values that `fit` moves away from those in the file by so many standard
    deviations of their prior that these are not credible.
    """
    return [name for name, strain in strains(fit).items() if abs(strain) > STRAINED]


def _cosine(a: Array, b: Array) -> float:
    """Cosine of the angle between two vectors of equal length; zero where one of them
    vanishes.
    """
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / (size or 1.0))


def reasons(findings: Findings) -> list[str]:
    """Sentences on why accepted effects are not named as the cause, or why a residual
    stays unexplained.
    """
    decision = findings.decision
    repeats = findings.model_tests.repeats
    fit = findings.accepted
    words = [
        f"{name} is right with probability {p:.2f} (named from {LEAST:g})"
        for name, p in decision.probabilities.items()
        if p < LEAST
    ]
    words += [
        f"{name} lies at the end of the range that is tried:"
        f" {plain(', '.join(amounts))}"
        for name, amounts in decision.at_ends.items()
    ]
    words += [
        f"{' and '.join(sorted(two))} displace equally or cancel, as if one other thing"
        " did both"
        for sets in findings.posterior.models
        for two, nats in sets.shared
        if sets.names == fit.names and nats > 0.0
    ]
    words += [
        f"{effect.name} has a shape by which it stands in for another law"
        for effect in fit.proxies
    ]
    words += filter(None, [decision.failure])
    by_run = held_out_gap.rms_by_run(fit, findings.quantities)
    rms, run = max(zip(by_run, (r.name for r in fit.runs), strict=True))
    if rms > ASTRAY * float(np.median(by_run)):
        words.append(f"run {run} differs from all others")
    if repeats.drifts:
        words.append(f"the specimen changes from run to run: {repeats.drift}")

    if repeats.differ:
        factor = max(repeats.inflation.values())
        words.append(
            f"repeats of one condition differ by {factor:.1f} times the stated noise"
        )

    return words


def describe_left(findings: Findings) -> str:
    """Sentence on the residuals that the accepted model leaves on held-out runs,
    followed by the reasons why no effect is named.
    """
    quantities = findings.quantities
    after = held_out_gap.sizes(findings.held_out_fits.after, quantities)
    noise = held_out_gap.floor(findings.held_out_fits.before.runs, quantities)
    units = {quantity.key: quantity.unit for quantity in quantities.values()}
    sizes = ", ".join(
        f"{after[key]:.3g} {unit} of {key.rsplit('_', 1)[0]} (noise {noise[key]:.2g})"
        for key, unit in units.items()
        if key in after
    )
    accepted = findings.accepted.model
    model = (
        f"the model with {accepted.name}" if accepted.effects else "the refitted model"
    )
    return "; ".join([f"{model} leaves {sizes} on held-out runs", *reasons(findings)])
