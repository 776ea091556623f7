"""Investigates the gap of any subject, stage by stage."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from cell.gap.diagnosis.lack_of_fit import ResidualTest
from cell.gap.fitting.base_fit import refit_base, refit_fine, strains, weak_directions
from cell.gap.fitting.crossvalidation import validate
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Evidence, Model, evidence
from cell.gap.fitting.projection import projection
from cell.gap.fitting.reml import Spread, spreads, with_scatter, with_spreads
from cell.gap.fitting.tasks import Simulate, run_all, run_one
from cell.gap.forward_selection import (
    ForwardSelection,
    Progress,
    refit_on_base,
    revised_base,
)
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, LikelihoodScale, family_wise, likelihood_scale
from cell.gap.selection.posterior import posterior
from cell.gap.selection.prior import filling_floor, immaterial
from cell.gap.selection.screening import ProbeResponses, Score, detectable, probe, ranking, table
from cell.gap.subject.subject import Subject
from cell.gap.verdict.decision import decide
from cell.gap.verdict.findings import Advice, BaseFit, Findings, Screen
from cell.gap.verdict.model_tests import advice, choose_and_refine, refit_held_out, run_model_tests
from cell.gap.verdict.offered_law import offered_law


def investigate(
    subject: Subject, held_out: Sequence[str], simulate: Simulate, progress: Progress, seed: int = 0
) -> Findings:
    """Find what the model of `subject` lacks, and test it on the runs `held_out`."""
    rng = np.random.default_rng(seed)
    train = [run for run in subject.runs if run.name not in held_out]
    test = [run for run in subject.runs if run.name in held_out]
    progress("refit the base", 0.02)
    evidence_of_fit = evidence(train)
    base_fit = _fit_base(subject, evidence_of_fit, simulate, rng)
    progress("screen the candidates", 0.12)
    screen = _screen(subject, base_fit, simulate)
    fits = Fits((base_fit.base,), screen.library)
    stages = ((ForwardSelection.refit_singles, 0.4), (ForwardSelection.refit_further, 0.75))
    for refit_more, share in stages:
        best_before = fits.best
        fits = refit_more(ForwardSelection(subject, simulate, progress, base_fit, screen), fits)
        if fits.best is best_before:
            continue
        revised = revised_base(simulate, fits, base_fit.scatter, evidence_of_fit)
        if revised is not None:
            progress("refit the base beside the best", share)
            base_fit = _judge_base(subject, *revised, simulate, rng)
            screen = _score_candidates(subject, base_fit, screen.probed)
            fits = refit_on_base(simulate, fits, base_fit.base, base_fit.scatter, evidence_of_fit)
            fits = replace(fits, library=screen.library)
    progress("judge", 0.8)
    sets = posterior(fits, fits.likelihood)
    choice = choose_and_refine(subject, simulate, fits, sets)
    tests = run_model_tests(subject, choice, sets, simulate, evidence_of_fit, rng)
    progress("show on held-out runs", 0.9)
    unseen = with_spreads(evidence(test), base_fit.scatter)
    held_out_fits = refit_held_out(subject, simulate, base_fit.base, choice.accepted, unseen, rng)
    progress("advise", 0.95)
    is_gap = bool(choice.accepted.model.effects) or base_fit.gap
    advice_given = advice(subject, screen, choice, tests, simulate) if is_gap else Advice()
    findings = Findings(
        subject, tuple(held_out), base_fit, screen, choice, sets, tests, held_out_fits, advice_given
    )
    return _with_law(findings, simulate, rng)


def _with_law(findings: Findings, simulate: Simulate, rng: np.random.Generator) -> Findings:
    """Findings with a law, where one is offered for a gap without a name."""
    if decide(findings) != "unexplained":
        return findings
    law = offered_law(findings.subject, simulate, findings.choice, findings.unseen.before, rng)
    return replace(findings, law=law)


def _fit_base(
    subject: Subject, runs: Evidence, simulate: Simulate, rng: np.random.Generator
) -> BaseFit:
    """Fit the base from its stated values, estimate run-to-run spreads, test what is left."""
    rough = refit_base(simulate, Model(subject.scope.base), runs)
    scatter = spreads(rough)
    return _judge_base(subject, with_scatter(rough, scatter, runs), scatter, simulate, rng)


def _judge_base(
    subject: Subject,
    rough: Estimate,
    scatter: Sequence[Spread],
    simulate: Simulate,
    rng: np.random.Generator,
) -> BaseFit:
    """Refit the base finely from `rough`, and test what it leaves beyond noise and scatter."""
    base = refit_fine(subject, simulate, rough)
    test = ResidualTest.of(base, rng)
    return BaseFit(
        base=run_one(simulate, validate(base)),
        repeats=test.repeats,
        misfit=test.misfit(),
        places=tuple(test.localise()),
        weak=tuple(weak_directions(base)),
        scatter=tuple(scatter),
        strained=_is_strained(subject, base),
    )


def _is_strained(subject: Subject, base: Estimate) -> bool:
    """Whether the fitted values of the base contradict their priors, jointly or one of them."""
    squares = np.square(list(strains(base).values()))
    if not subject.scope.believed or not len(squares):
        return False
    any_one = len(squares) * float(special.chdtrc(1, squares.max()))  # Bonferroni
    return min(float(special.chdtrc(len(squares), squares.sum())), any_one) < ALPHA


def _screen(subject: Subject, fitted: BaseFit, simulate: Simulate) -> Screen:
    """Probe all candidates at the refitted base, and score them."""
    base = fitted.base.estimate
    probed = run_all(simulate, [probe(base, c) for c in subject.scope.candidates])
    return _score_candidates(subject, fitted, probed)


def _score_candidates(
    subject: Subject, fitted: BaseFit, probed: Sequence[ProbeResponses]
) -> Screen:
    """Score the `probed` candidates by the linear screen at the refitted base.

    Like the posterior it gives every absent effect of the library its spike prior.
    """
    base, likelihood = fitted.base.estimate, likelihood_scale([fitted.base])
    library = filling_floor(base, probed, believed=subject.scope.believed)
    about = projection(base, nuisance=immaterial(library))
    equations = table(about, probed)
    singles = ranking(equations)
    return Screen(
        tuple(probed),
        equations,
        tuple(singles),
        _screened_p(subject, singles, likelihood),
        detectable(about, probed, likelihood),
        library,
    )


def _screened_p(
    subject: Subject, singles: Sequence[Score], likelihood: LikelihoodScale
) -> dict[str, float]:
    """Likelihood-ratio p-values of the linear screen by name, family-wise over the library."""
    size = {c.name: len(c.parameters) for c in subject.scope.candidates}
    raw = {
        s.names[0]: float(special.chdtrc(size[s.names[0]], 2.0 * s.gain / likelihood.inefficiency))
        for s in singles
    }
    return family_wise(raw, list(size))
