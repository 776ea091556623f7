"""Finds what the model of a subject lacks, stage by stage, from its measured runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.lack_of_fit import Bin, ResidualTest
from cell.gap.diagnosis.next_experiment import Recommendation, advise
from cell.gap.fitting import Progress, Simulate, run_all, run_one
from cell.gap.fitting.base_fit import (
    projection,
    refit_base,
    refit_fine,
    strains,
)
from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import FitEstimate, linearise, refit
from cell.gap.fitting.model import Model, Point, requests, stated
from cell.gap.fitting.reml import (
    estimate_spreads,
    reml_spreads,
    with_spreads,
    with_unknowns,
)
from cell.gap.forward_selection import (
    BaseStart,
    Models,
    refit_further,
    refit_on_base,
    refit_singles,
    revised_base,
)
from cell.gap.selection.choice import choose, join_overlapping, rivals
from cell.gap.selection.likelihood import ALPHA, Fits, holm, likelihood_scale
from cell.gap.selection.posterior import (
    Posterior,
    floor_responses,
    posterior,
    spike_responses,
)
from cell.gap.selection.screening import (
    ProbeResponses,
    detection_limits,
    probe_equations,
    ranked_singles,
    run_probes,
)
from cell.gap.selection.search import Search
from cell.gap.subject.subject import FitRun, Scope, Subject
from cell.gap.verdict.decision import decide, doubtful_values
from cell.gap.verdict.findings import (
    BaseFit,
    Findings,
    FitResults,
    HeldOutFits,
    ModelTests,
    Screen,
)
from cell.gap.verdict.offered_law import offered_law
from drivers.base.types import Array


def investigate(
    subject: Subject,
    held_out: Sequence[str],
    simulate: Simulate,
    progress: Progress,
) -> Findings:
    """Find which effects the model of `subject` lacks, and test them on the runs
    `held_out`.
    """
    fitted, unseen = (
        [run for run in subject.runs if (run.name in held_out) is held]
        for held in (False, True)
    )
    stages = Investigation(
        subject=subject,
        simulate=simulate,
        progress=progress,
        fitted=fitted,
        rng=np.random.default_rng(0),
    )
    models = stages.extend(stages.begin(), refit_singles, 0.4)
    models = stages.extend(models, refit_further, 0.75)
    findings = stages.judge(models, unseen, held_out)
    if findings.decision.kind != "unexplained":
        return findings

    before = findings.held_out_fits.before
    law = offered_law(subject, simulate, findings.fits, before, stages.rng)
    return replace(findings, law=law)


@dataclass(frozen=True, slots=True)
class Investigation:
    """Stages of the investigation of `subject`; `fitted` are those of its runs that are
    not held out, with all random unknowns.
    """

    subject: Subject
    simulate: Simulate
    progress: Progress
    fitted: Sequence[FitRun]
    rng: np.random.Generator

    @property
    def scope(self) -> Scope:
        """Base parameters and candidate effects of the subject that the investigation
        fits.
        """
        return self.subject.scope

    def begin(self) -> Models:
        """Fit the base, and screen all effects of the library about it."""
        self.progress("refit the base", 0.02)
        rough = refit_base(self.simulate, Model(self.scope.base), self.fitted)
        scatter = reml_spreads(rough)
        start = BaseStart(
            *with_unknowns(rough, with_spreads(self.fitted, scatter)), scatter
        )
        base_fit = self._judge_base(start)
        self.progress("screen the candidates", 0.12)
        probes = [
            run_probes(base_fit.base, candidate) for candidate in self.scope.candidates
        ]
        screen = self._score_candidates(base_fit, run_all(self.simulate, probes))
        return Models(base_fit, screen, Fits((base_fit.base,), screen.library))

    def extend(
        self,
        models: Models,
        add_models: Callable[[Search, Models, Progress], Fits],
        fraction: float,
    ) -> Models:
        """Add models to `models` by the function `add_models`; all are fitted again
        where the best one revises the base.

        `fraction` of the whole investigation is done by then.
        """
        probed = models.screen.probed
        search = Search(self.simulate, self.scope.candidates, probed)
        fits = add_models(search, models, self.progress)
        revised = None
        if fits.best is not models.fits.best:
            scatter = models.base_fit.scatter
            revised = revised_base(self.simulate, fits, scatter, self.fitted)
        if not revised:
            return models._replace(fits=fits)

        self.progress("refit the base beside the best", fraction)
        base_fit = self._judge_base(revised)
        screen = self._score_candidates(base_fit, probed)
        fits = refit_on_base(
            search, fits, base_fit.base, spreads=base_fit.scatter, complete=self.fitted
        )
        return Models(base_fit, screen, replace(fits, library=screen.library))

    def _judge_base(self, start: BaseStart) -> BaseFit:
        """Fit the model without effects from `start`, and test the residuals of the
        fit.

        They are corrected for the coarse simulation, and tested against noise, repeats
        and priors.
        """
        model = Model(self.scope.base)
        base = refit_fine(
            self.subject, self.simulate, model, coarse=start.runs, start=start.point
        )
        test = ResidualTest.of(base, self.rng)
        return BaseFit(
            base=run_one(self.simulate, validate(base)),
            repeats=test.repeats,
            misfit=test.misfit(),
            places=test.test_bins(),
            scatter=start.scatter,
            strained=self.scope.believed and _is_strained(base),
        )

    def _score_candidates(
        self, fitted: BaseFit, probed: Sequence[ProbeResponses]
    ) -> Screen:
        """Predict what each of the `probed` candidate effects gains, by the linear
        screen.

        Like the posterior it gives every absent effect of the library its spike prior.
        """
        base = fitted.base
        likelihood = likelihood_scale([fitted.base])
        library = floor_responses(base, probed, believed=self.scope.believed)
        about = projection(base, nuisance=spike_responses(library))
        equations = probe_equations(about, probed)
        singles = ranked_singles(equations)
        ratios = {s.names[0]: 2.0 * s.gain / likelihood.inefficiency for s in singles}
        p = {
            candidate.name: special.chdtrc(
                len(candidate.parameters), ratios.get(candidate.name, 0.0)
            )
            for candidate in self.scope.candidates
        }
        return Screen(
            probed=probed,
            equations=equations,
            singles=singles,
            p=holm(p),
            detectable=detection_limits(about, probed, likelihood),
            library=library,
        )

    def judge(
        self, models: Models, unseen: Sequence[FitRun], held_out: Sequence[str]
    ) -> Findings:
        """Choose a model, test it, and fit it to the runs `unseen`, whose names are
        `held_out`.
        """
        base_fit, screen, fits = models
        self.progress("judge", 0.8)
        sets = posterior(fits, fits.likelihood)
        accepted, fits = self.choose(fits, sets)
        tests = self._test_model(accepted, fits, sets)
        self.progress("show on held-out runs", 0.9)
        unseen = with_spreads(unseen, base_fit.scatter)
        held_out_fits = self._refit_held_out(base_fit.base, accepted, unseen)
        self.progress("advise", 0.95)
        is_gap = bool(accepted.effects) or base_fit.gap
        results = FitResults(
            subject=self.subject,
            held_out=held_out,
            base_fit=base_fit,
            screen=screen,
            accepted=accepted,
            fits=fits,
            posterior=sets,
            model_tests=tests,
            held_out_fits=held_out_fits,
        )
        advised = self.advise(screen, accepted, fits, tests) if is_gap else ()
        return Findings.of(results, decide(results), advised)

    def choose(self, fits: Fits, sets: Posterior) -> tuple[CrossValidatedFit, Fits]:
        """Choose the model to accept and refit it with the finest simulation; also
        returns `fits` with this refit.

        Its probability in `sets` stays: those compare all models by the same, coarser
        simulation.
        """
        rough = choose(fits, sets)
        if not rough.effects:
            return rough, fits
        fine = refit_fine(
            self.subject,
            self.simulate,
            rough.model,
            coarse=rough.runs,
            start=rough.point,
        )
        refined = run_one(self.simulate, validate(fine))
        models = [refined if model is rough else model for model in fits.models]
        return refined, replace(fits, models=models)

    def _test_model(
        self, accepted: CrossValidatedFit, fits: Fits, sets: Posterior
    ) -> ModelTests:
        """Test the `accepted` model for lack of fit, and against its rivals among
        `fits`.

        `sets` are the probabilities of all fitted models.
        """
        residual_test = ResidualTest.of(accepted, self.rng)
        close = rivals(accepted, fits, sets) if accepted.effects else []
        exchanged = [sorted(accepted.names ^ rival.names) for rival in close]
        doubtful = doubtful_values(accepted, fits, self.subject)
        alike = join_overlapping([*exchanged, *doubtful])
        scatter = estimate_spreads(self.simulate, accepted, self.fitted)
        runs, start = with_unknowns(accepted, with_spreads(self.fitted, scatter))
        return ModelTests(
            misfit=residual_test.misfit(),
            repeats=residual_test.repeats,
            rivals=close,
            classes=alike,
            sized=run_one(self.simulate, refit(accepted.model, runs, start)),
            scatter=scatter,
            places=self._matching_places(accepted, fits),
        )

    def _matching_places(
        self, accepted: CrossValidatedFit, fits: Fits
    ) -> Sequence[Bin]:
        """Bins of samples where residuals of the base match the accepted effects; empty
        without accepted effects.
        """
        if not accepted.effects:
            return ()
        others = [
            model for model in fits.models if model.effects and model is not accepted
        ]
        test = ResidualTest.of(fits.base, self.rng)
        return test.matching(accepted, others)

    def _refit_held_out(
        self,
        base: CrossValidatedFit,
        accepted: CrossValidatedFit,
        unseen: Sequence[FitRun],
    ) -> HeldOutFits:
        """Fit base and accepted model to the held-out runs `unseen`, with their shared
        parameters fixed.
        """
        fits = [base, accepted] if accepted.effects else [base]
        refined = [
            self.subject.refine(requests(fit.model, unseen, stated(unseen, fit.shared)))
            for fit in fits
        ]
        # both gaps in the same units, with the floors of either simulation
        by_run = map(_with_largest_floor, zip(*refined, strict=True))
        before, *others = (
            held_out_gap.fit_held_out(
                self.simulate, fit.model.holding(fit.shared), runs
            )
            for fit, runs in zip(fits, zip(*by_run, strict=True), strict=True)
        )
        after = others[0] if others else before
        return HeldOutFits(before, after, held_out_gap.shrink(before, after, self.rng))

    def advise(
        self,
        screened: Screen,
        accepted: CrossValidatedFit,
        fits: Fits,
        tests: ModelTests,
    ) -> Sequence[Recommendation]:
        """Experiments that would separate the accepted model from a rival, the best
        first.

        Planned runs scatter in the quantities that scatter in the runs so far.
        """
        likelihood = fits.likelihood
        second = _alternative(screened, accepted, fits, tests)
        if not second:
            return ()
        experiments = [
            e._replace(run=with_spreads([e.run], tests.scatter)[0])
            for e in self.subject.experiments()
        ]
        return run_one(self.simulate, advise(accepted, second, experiments, likelihood))


def in_all_runs(findings: Findings, simulate: Simulate) -> FitEstimate:
    """Estimate of the accepted model in fitted and held-out runs, not fitted again."""
    fitted = findings.accepted
    held_out = findings.held_out_fits.after
    model = fitted.model
    unseen = held_out.runs
    point = Point(fitted.shared, held_out.local)
    raw, jacobians = run_one(simulate, linearise(model, unseen, point))
    return FitEstimate.at(
        model,
        (*fitted.runs, *unseen),
        Point(fitted.shared, (*fitted.local, *point.local)),
        (*fitted.raw, *raw),
        (*fitted.jacobians, *jacobians),
    )


def _with_largest_floor(runs: Sequence[FitRun]) -> list[FitRun]:
    """Copies of one run, refined in several ways, with the largest floor of all."""
    floor = np.max([run.samples.floor for run in runs], axis=0)
    return [replace(run, samples=replace(run.samples, floor=floor)) for run in runs]


def _is_strained(base: FitEstimate) -> bool:
    """Whether fitted base values contradict their priors, jointly or a single one
    (chi^2 tests).
    """
    squares = [strain**2 for strain in strains(base).values()]
    count = len(squares)
    if not count:
        return False
    any_one = count * special.chdtrc(1, max(squares))  # Bonferroni
    return bool(min(special.chdtrc(count, sum(squares)), any_one) < ALPHA)


def _alternative(
    screened: Screen, accepted: CrossValidatedFit, fits: Fits, tests: ModelTests
) -> tuple[Model, Array] | None:
    """Model to separate from `accepted`, with its shared values (P,): the closest
    rival, else the best other model of that size, else an effect not in it.
    """
    size = len(accepted.effects) or 1
    others = [m for m in fits.of_size(size) if m is not accepted]
    closest = next(iter(tests.rivals or others), None)
    if closest:
        return closest.model, closest.shared

    known = accepted.names
    tried = (p.candidate for p in screened.probed if not p.dead)
    candidate = next((c for c in tried if c.name not in known), None)
    if not candidate:
        return None

    base, _ = accepted.values
    model = Model(accepted.model.base, (candidate,))
    return model, model.join(base, {candidate.name: np.array(candidate.probes[0][0])})
