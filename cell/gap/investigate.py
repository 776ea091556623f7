"""Investigates the gap of any subject, stage by stage."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.lack_of_fit import Bin, ResidualTest
from cell.gap.diagnosis.next_experiment import advise, repeatability_gains
from cell.gap.fitting.base_fit import refine, refit_base, refit_fine, strains, weak_directions
from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import Estimate, final_fit
from cell.gap.fitting.model import Evidence, Model, Point, evidence
from cell.gap.fitting.projection import projection
from cell.gap.fitting.reml import (
    Spread,
    estimate_spreads,
    spreads,
    with_own_scatter,
    with_scatter,
    with_spreads,
)
from cell.gap.fitting.tasks import Simulate, run_all, run_one
from cell.gap.forward_selection import ForwardSelection, Progress, refit_on_base, revised_base
from cell.gap.selection.choice import Choice, choose, classes, merged, rivals
from cell.gap.selection.likelihood import ALPHA, Fits, by_loss, family_wise, likelihood_scale
from cell.gap.selection.posterior import Posterior, filling_floor, immaterial, posterior
from cell.gap.selection.screening import ProbeResponses, detectable, probe, ranking, table
from cell.gap.subject.subject import Subject
from cell.gap.verdict.decision import decide, refuted_values
from cell.gap.verdict.findings import Advice, BaseFit, Findings, HeldOutFits, ModelTests, Screen
from cell.gap.verdict.offered_law import offered_law
from drivers.types import Array


def investigate(
    subject: Subject, held_out: Sequence[str], simulate: Simulate, progress: Progress, seed: int = 0
) -> Findings:
    """Find what the model of `subject` lacks, and test it on the runs `held_out`."""
    fitted = evidence([run for run in subject.runs if run.name not in held_out])
    stages = Stages(subject, simulate, fitted, np.random.default_rng(seed))
    progress("refit the base", 0.02)
    base_fit = stages.fit_base()
    progress("screen the candidates", 0.12)
    screen = stages.screen(base_fit)
    fits = Fits((base_fit.base,), screen.library)
    searches = ((ForwardSelection.refit_singles, 0.4), (ForwardSelection.refit_further, 0.75))
    for refit_more, share in searches:
        best_before = fits.best
        fits = refit_more(ForwardSelection(subject, simulate, progress, base_fit, screen), fits)
        if fits.best is best_before:
            continue
        revised = revised_base(simulate, fits, base_fit.scatter, fitted)
        if revised is not None:
            progress("refit the base beside the best", share)
            base_fit = stages.judge_base(*revised)
            screen = stages.score_candidates(base_fit, screen.probed)
            fits = refit_on_base(simulate, fits, base_fit.base, base_fit.scatter, fitted)
            fits = replace(fits, library=screen.library)
    progress("judge", 0.8)
    sets = posterior(fits, fits.likelihood)
    choice = stages.choose(fits, sets)
    tests = stages.test_model(choice, sets)
    progress("show on held-out runs", 0.9)
    unseen = evidence([run for run in subject.runs if run.name in held_out])
    unseen = with_spreads(unseen, base_fit.scatter)
    held_out_fits = stages.refit_held_out(base_fit.base, choice.accepted, unseen)
    progress("advise", 0.95)
    is_gap = bool(choice.accepted.model.effects) or base_fit.gap
    advice = stages.advise(screen, choice, tests) if is_gap else Advice()
    findings = Findings(
        subject, tuple(held_out), base_fit, screen, choice, sets, tests, held_out_fits, advice
    )
    if decide(findings) != "unexplained":
        return findings
    law = offered_law(subject, simulate, choice, held_out_fits.before, stages.rng)
    return replace(findings, law=law)


@dataclass(frozen=True, slots=True)
class Stages:
    """Stages of an investigation of `subject`; `fitted` are its runs with every random unknown."""

    subject: Subject
    simulate: Simulate
    fitted: Evidence
    rng: np.random.Generator

    def fit_base(self) -> BaseFit:
        """Fit the base from its stated values, estimate run-to-run spreads, test what is left."""
        rough = refit_base(self.simulate, Model(self.subject.scope.base), self.fitted)
        scatter = spreads(rough)
        return self.judge_base(with_scatter(rough, scatter, self.fitted), scatter)

    def judge_base(self, rough: Estimate, scatter: Sequence[Spread]) -> BaseFit:
        """Refit the base finely from `rough`, and test what it leaves beyond noise and scatter."""
        base = refit_fine(self.subject, self.simulate, rough)
        test = ResidualTest.of(base, self.rng)
        return BaseFit(
            base=run_one(self.simulate, validate(base)),
            repeats=test.repeats,
            misfit=test.misfit(),
            places=tuple(test.localise()),
            weak=tuple(weak_directions(base)),
            scatter=tuple(scatter),
            strained=self.subject.scope.believed and _is_strained(base),
        )

    def screen(self, fitted: BaseFit) -> Screen:
        """Simulate the probes of every candidate at the fitted base; predict what each gains."""
        tasks = [probe(fitted.base.estimate, c) for c in self.subject.scope.candidates]
        return self.score_candidates(fitted, run_all(self.simulate, tasks))

    def score_candidates(self, fitted: BaseFit, probed: Sequence[ProbeResponses]) -> Screen:
        """Score the `probed` candidates by the linear screen at the refitted base.

        Like the posterior it gives every absent effect of the library its spike prior.
        """
        base, likelihood = fitted.base.estimate, likelihood_scale([fitted.base])
        library = filling_floor(base, probed, believed=self.subject.scope.believed)
        about = projection(base, nuisance=immaterial(library))
        equations = table(about, probed)
        singles = ranking(equations)
        size = {c.name: len(c.parameters) for c in self.subject.scope.candidates}
        p = {  # likelihood ratios
            name: float(special.chdtrc(size[name], 2.0 * s.gain / likelihood.inefficiency))
            for s in singles
            for name in s.names
        }
        return Screen(
            probed=tuple(probed),
            equations=equations,
            singles=tuple(singles),
            p=family_wise(p, list(size)),
            detectable=detectable(about, probed, likelihood),
            library=library,
        )

    def choose(self, fits: Fits, sets: Posterior) -> Choice:
        """Choose the accepted model among `fits`, and refit it against the finest simulation.

        Its probability in `sets` stays: those compare all models by the same, coarser simulation.
        """
        choice = choose(fits, sets)
        rough = choice.accepted
        if not rough.model.effects:
            return choice
        fine = refit_fine(self.subject, self.simulate, rough.estimate)
        refined = run_one(self.simulate, validate(fine))
        models = tuple(refined if m is rough else m for m in fits.models)
        return replace(choice, accepted=refined, fits=replace(fits, models=models))

    def test_model(self, choice: Choice, sets: Posterior) -> ModelTests:
        """Test the accepted model of `choice` for lack of fit, and against its rivals.

        `sets` are the probabilities of all fitted models.
        """
        best = choice.accepted.estimate
        residual_test = ResidualTest.of(best, self.rng)
        close = rivals(choice.accepted, choice.fits, sets) if best.model.effects else []
        alike = merged([*classes(choice.accepted, close), *refuted_values(best, self.subject)])
        scatter = estimate_spreads(self.simulate, best, self.fitted)
        sized = final_fit(with_own_scatter(self.simulate, best, scatter, self.fitted))
        return ModelTests(
            misfit=residual_test.misfit(),
            repeats=residual_test.repeats,
            rivals=tuple(close),
            classes=tuple(map(tuple, alike)),
            sized=run_one(self.simulate, sized),
            scatter=scatter,
            places=self._matching_places(choice),
        )

    def _matching_places(self, choice: Choice) -> tuple[Bin, ...]:
        """Bins where the residuals of the base match the accepted effects; none without any."""
        accepted, models = choice.accepted, choice.fits.models
        if not accepted.model.effects:
            return ()
        others = [m.estimate for m in models if m.model.effects and m is not accepted]
        test = ResidualTest.of(choice.fits.base.estimate, self.rng)
        return tuple(test.matching(accepted.estimate, others))

    def refit_held_out(
        self, base: CrossValidatedFit, accepted: CrossValidatedFit, unseen: Evidence
    ) -> HeldOutFits:
        """Refit base and accepted model to runs `unseen`, with all shared parameters fixed."""

        def refine_for(fit: Estimate) -> Evidence:
            return refine(self.subject, fit.model, Point(fit.shared, unseen.start()), unseen)

        known = refine_for(base.estimate)
        if not accepted.model.effects:
            before = after = held_out_gap.unseen(self.simulate, base.estimate, known)
        else:
            fine = refine_for(accepted.estimate)
            # both gaps in the same units, with the floors of either simulation
            scales = tuple(map(np.maximum, known.scales, fine.scales))
            before, after = (
                held_out_gap.unseen(self.simulate, fit.estimate, replace(runs, scales=scales))
                for fit, runs in ((base, known), (accepted, fine))
            )
        return HeldOutFits(before, after, held_out_gap.shrink(before, after, self.rng))

    def advise(self, screened: Screen, choice: Choice, tests: ModelTests) -> Advice:
        """Experiments and better repeats that would separate the accepted model from a rival.

        Planned runs scatter in the quantities that scatter in the runs so far.
        """
        second = _alternative(screened, choice, tests)
        if second is None:
            return Advice()
        first = choice.accepted.estimate
        more = run_one(self.simulate, repeatability_gains(first, second, choice.fits.likelihood))
        experiments = [
            replace(e, run=with_spreads(evidence([e.run]), tests.scatter).runs[0])
            for e in self.subject.experiments()
        ]
        planned = run_one(self.simulate, advise(first, second, experiments, choice.fits.likelihood))
        return Advice(tuple(planned), tuple(more))


def _is_strained(base: Estimate) -> bool:
    """Whether the fitted values of the base contradict their priors, jointly or one of them."""
    squares = np.square(list(strains(base).values()))
    if not len(squares):
        return False
    any_one = len(squares) * float(special.chdtrc(1, squares.max()))  # Bonferroni
    return min(float(special.chdtrc(len(squares), squares.sum())), any_one) < ALPHA


def _alternative(screened: Screen, choice: Choice, tests: ModelTests) -> tuple[Model, Array] | None:
    """Model to separate first from the accepted one, with its shared values (P,)."""
    accepted = choice.accepted.estimate
    size = len(accepted.model.effects) or 1
    others = [m for m in choice.fits.models
              if len(m.model.effects) == size and m is not choice.accepted]  # fmt: skip
    closest = next(iter(tests.rivals or by_loss(others, choice.fits.likelihood)), None)
    if closest is not None:
        return closest.model, closest.estimate.shared
    alive = [p.candidate for p in screened.probed
             if not p.dead and p.candidate.name not in accepted.model.names]  # fmt: skip
    if not alive:
        return None
    candidate, (base, _) = alive[0], accepted.model.split(accepted.shared)
    model = Model(accepted.model.base, (candidate,))
    return model, model.join(base, {candidate.name: np.array(candidate.probes[0][0])})
