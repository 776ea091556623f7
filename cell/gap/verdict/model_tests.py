"""Tests of the accepted model, its gap on held-out runs, and advice on telling it from a rival."""

from dataclasses import replace

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.lack_of_fit import Bin, ResidualTest
from cell.gap.diagnosis.next_experiment import advise, repeatability_gains
from cell.gap.fitting.base_fit import refine, refit_fine
from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import Estimate, final_fit
from cell.gap.fitting.model import Evidence, Model, Point, evidence
from cell.gap.fitting.reml import estimate_spreads, with_own_scatter, with_spreads
from cell.gap.fitting.tasks import Simulate, run_one
from cell.gap.selection.choice import Choice, choose, classes, merged, rivals
from cell.gap.selection.fits import Fits, by_loss
from cell.gap.selection.posterior import Posterior
from cell.gap.subject.subject import Subject
from cell.gap.verdict.decision import refuted_values
from cell.gap.verdict.findings import Advice, HeldOutFits, ModelTests, Screen
from drivers.types import Array


def choose_and_refine(subject: Subject, simulate: Simulate, fits: Fits, sets: Posterior) -> Choice:
    """Choose the accepted model among `fits`, and refit it against the finest simulation.

    Its probability in `sets` stays: those compare all models by the same, coarser simulation.
    """
    choice = choose(fits, sets)
    rough = choice.accepted
    if not rough.model.effects:
        return choice
    refined = run_one(simulate, validate(refit_fine(subject, simulate, rough.estimate)))
    models = tuple(refined if m is rough else m for m in fits.models)
    return replace(choice, accepted=refined, fits=replace(fits, models=models))


def run_model_tests(
    subject: Subject,
    choice: Choice,
    sets: Posterior,
    simulate: Simulate,
    complete: Evidence,
    rng: np.random.Generator,
) -> ModelTests:
    """Test the accepted model of `choice` for lack of fit, and against its rivals.

    `sets` are the probabilities of all fitted models; `complete` are the fitted runs with every
    random unknown.
    """
    best = choice.accepted.estimate
    residual_test = ResidualTest.of(best, rng)
    close = rivals(choice.accepted, choice.fits, sets) if best.model.effects else []
    alike = merged([*classes(choice.accepted, close), *refuted_values(best, subject)])
    scatter = estimate_spreads(simulate, best, complete)
    return ModelTests(
        misfit=residual_test.misfit(),
        repeats=residual_test.repeats,
        rivals=tuple(close),
        classes=tuple(map(tuple, alike)),
        sized=run_one(simulate, final_fit(with_own_scatter(simulate, best, scatter, complete))),
        scatter=scatter,
        places=_matching_places(choice, rng),
    )


def _matching_places(choice: Choice, rng: np.random.Generator) -> tuple[Bin, ...]:
    """Bins where the residuals of the base match the accepted effects; none without any."""
    fitted, base = choice.accepted, choice.fits.base.estimate
    if not fitted.model.effects:
        return ()
    others = [m.estimate for m in choice.fits.models if m.model.effects and m is not fitted]
    return tuple(ResidualTest.of(base, rng).matching(fitted.estimate, others))


def refit_held_out(
    subject: Subject,
    simulate: Simulate,
    base: CrossValidatedFit,
    accepted: CrossValidatedFit,
    test: Evidence,
    rng: np.random.Generator,
) -> HeldOutFits:
    """Refit base and accepted model to held-out runs `test`, with all shared parameters fixed."""

    def refine_for(fit: Estimate) -> Evidence:
        return refine(subject, fit.model, Point(fit.shared, test.start()), test)

    known = refine_for(base.estimate)
    if not accepted.model.effects:
        before = after = held_out_gap.unseen(simulate, base.estimate, known)
    else:
        fine = refine_for(accepted.estimate)
        # both gaps in the same units, with the floors of either simulation
        scales = tuple(map(np.maximum, known.scales, fine.scales))
        before = held_out_gap.unseen(simulate, base.estimate, Evidence(known.runs, scales))
        after = held_out_gap.unseen(simulate, accepted.estimate, Evidence(fine.runs, scales))
    return HeldOutFits(before, after, held_out_gap.shrink(before, after, rng))


def advice(
    subject: Subject, screened: Screen, choice: Choice, tests: ModelTests, simulate: Simulate
) -> Advice:
    """Experiments and better repeats that would separate the accepted model from a rival.

    Planned runs scatter in the quantities that scatter in the runs so far.
    """
    second = _alternative(screened, choice, tests)
    if second is None:
        return Advice()
    first = choice.accepted.estimate
    more = run_one(simulate, repeatability_gains(first, second, choice.fits.likelihood))
    experiments = [
        replace(e, run=with_spreads(evidence([e.run]), tests.scatter).runs[0])
        for e in subject.experiments()
    ]
    planned = run_one(simulate, advise(first, second, experiments, choice.fits.likelihood))
    return Advice(tuple(planned), tuple(more))


def _alternative(screened: Screen, choice: Choice, tests: ModelTests) -> tuple[Model, Array] | None:
    """Model to separate first from the accepted one, with its shared values (P,)."""
    size = len(choice.accepted.model.effects) or 1
    others = [m for m in choice.fits.models
              if len(m.model.effects) == size and m is not choice.accepted]  # fmt: skip
    closest = next(iter(tests.rivals or by_loss(others, choice.fits.likelihood)), None)
    if closest is not None:
        return closest.model, closest.estimate.shared
    accepted = choice.accepted.estimate
    known = {effect.name for effect in accepted.model.effects}
    alive = [p.candidate for p in screened.probed
             if not p.dead and p.candidate.name not in known]  # fmt: skip
    if not alive:
        return None
    candidate, (base, _) = alive[0], accepted.model.split(accepted.shared)
    smallest = np.array(candidate.probes[0][0])
    model = Model(accepted.model.base, (candidate,))
    return model, model.join(base, {candidate.name: smallest})
