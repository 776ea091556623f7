"""Results of an investigation, stage by stage."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Self

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.lack_of_fit import Bin, Repeats, stronger_of_two
from cell.gap.diagnosis.next_experiment import Recommendation
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.reml import Spread
from cell.gap.selection.likelihood import ALPHA, Fits, LikelihoodScale
from cell.gap.selection.posterior import Posterior
from cell.gap.selection.screening import ProbeEquations, ProbeResponses, Score
from cell.gap.subject.subject import Candidate, Quantity, Scope, Subject
from cell.gap.verdict.offered_law import OfferedLaw
from cell.gap.verdict.schema import Kind, VerdictEvidence
from drivers.base.types import Array


@dataclass(frozen=True, slots=True)
class BaseFit:
    """Fit of the parameters in the file of a strip or mechanism, without any effect,
    and tests of the residuals that this leaves.

    `misfit` is the p-value of the residuals under noise; `scatter` are the quantities
    that differ from run to run; `strained` where the fitted values contradict their
    priors.
    """

    base: CrossValidatedFit
    repeats: Repeats
    misfit: float
    places: Sequence[Bin]
    scatter: tuple[Spread, ...] = ()
    strained: bool = False

    @property
    def doubted(self) -> bool:
        """Whether the refitted file leaves more than noise, or needs values that
        contradict what it states of them.
        """
        return self.gap or self.strained

    @property
    def gap(self) -> bool:
        """Whether the refitted file leaves more than noise in some group of samples,
        over all samples, or between repeated runs.
        """
        seen = self.misfit < ALPHA or any(place.p < ALPHA for place in self.places)
        return seen or self.repeats.drifts or self.repeats.differ


class Screen(NamedTuple):
    """Linear estimate of what each candidate effect could explain: responses of the
    simulation to small amounts of it, and the gains that they predict.

    `singles` are the scores of single effects, `p` their p-values by name; `detectable`
    are detection limits by name, None where no possible size would show; `library` has
    the whitened response (N, k) to the amount of each effect that fills the error
    floor.
    """

    probed: Sequence[ProbeResponses]
    equations: ProbeEquations
    singles: Sequence[Score]
    p: dict[str, float]
    detectable: dict[str, float | None]
    library: dict[str, Array]


class ModelTests(NamedTuple):
    """Tests of the accepted model that may cast doubt on it, such as whether its
    residuals are noise and whether other effects do as well.

    `misfit` is the p-value of its residuals under noise; `repeats` are compared in its
    residuals. `classes` are effects that the runs do not separate, `scatter` the
    quantities that differ from run to run beside it, `sized` the model fitted with
    these, from which sizes are estimated. `places` are tests of all groups of samples
    for the accepted effects in the residuals of the base.
    """

    misfit: float
    repeats: Repeats
    rivals: Sequence[CrossValidatedFit]
    classes: Sequence[Sequence[str]]
    sized: FitEstimate
    scatter: tuple[Spread, ...] = ()
    places: Sequence[Bin] = ()

    @property
    def remains(self) -> bool:
        """Whether the accepted model leaves residuals larger than noise explains."""
        return self.misfit < ALPHA


@dataclass(frozen=True, slots=True)
class HeldOutFits:
    """Models without and with the accepted effects, each fitted to the runs that were
    held out, and how much the residual shrinks from one to the other.
    """

    before: FitEstimate
    after: FitEstimate
    shrink: held_out_gap.Shrink

    @property
    def changed(self) -> bool:
        """Whether an effect was accepted; where none was, `after` is the same fit as
        `before`.
        """
        return self.after is not self.before

    @property
    def by_key(self) -> dict[str, FitEstimate]:
        """Fits to the held-out runs: under `before` the one without effects and, where
        an effect was accepted, under `after` the one with it.
        """
        return {"before": self.before} | ({"after": self.after} if self.changed else {})


@dataclass(frozen=True, slots=True)
class FitResults:
    """All fits and tests of an investigation by which its verdict is decided.

    `accepted` is the model that was chosen among `fits`: the base where no effect was
    accepted.
    """

    subject: Subject
    held_out: Sequence[str]
    base_fit: BaseFit
    screen: Screen
    accepted: CrossValidatedFit
    fits: Fits
    posterior: Posterior
    model_tests: ModelTests
    held_out_fits: HeldOutFits

    @property
    def scope(self) -> Scope:
        """What the fit of the strip or mechanism may change: parameters of its file,
        and candidate effects.
        """
        return self.subject.scope

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Measured quantities in which residuals are shown, such as lengths in mm, by
        the name of their channel.
        """
        return self.scope.quantities

    @property
    def base(self) -> CrossValidatedFit:
        """Model of the refitted file without added effects."""
        return self.base_fit.base

    @property
    def places(self) -> Sequence[Bin]:
        """Tests of all groups of samples for residuals without effects that exceed
        noise or match the accepted effects, the strongest first.
        """
        return stronger_of_two(self.base_fit.places, self.model_tests.places)

    @property
    def likelihood(self) -> LikelihoodScale:
        """Scale by which the log-likelihoods of all models are divided, because
        residuals vary more than noise and neighbours are not independent.
        """
        return self.fits.likelihood

    @property
    def separable(self) -> list[Candidate]:
        """Accepted effects that the runs can tell apart from all other candidates."""
        doubtful = {name for group in self.model_tests.classes for name in group}
        return [
            effect for effect in self.accepted.effects if effect.name not in doubtful
        ]


class DecidedVerdict(NamedTuple):
    """Verdict on the accepted model, with the probabilities and the evidence on which
    it rests.

    `named` are the credible effects that the runs tell apart from all others, and
    `probabilities` are those of all accepted effects by name, calibrated. `evidence` is
    that of the least probable named effect or, if none is named, accepted effect.
    `failure` is a clause on a model that predicts unseen runs no better, else empty;
    `at_ends` are amounts at an end of the range that is tried, by effect; `unseen_gap`
    is the excess residual [noise] of the base on held-out runs.
    """

    kind: Kind
    named: Sequence[str]
    probabilities: Mapping[str, float]
    evidence: VerdictEvidence
    failure: str
    at_ends: Mapping[str, Sequence[str]]
    unseen_gap: float


@dataclass(frozen=True, slots=True)
class Findings(FitResults):
    """All results of the investigation of a strip or mechanism, together with the
    verdict and the experiments that would say more.

    `experiments` would separate the accepted model from another one, the best first;
    `law` describes what no effect explains, if one is offered.
    """

    decision: DecidedVerdict
    experiments: Sequence[Recommendation]
    law: OfferedLaw | None = None

    @classmethod
    def of(
        cls,
        results: FitResults,
        decision: DecidedVerdict,
        experiments: Sequence[Recommendation],
    ) -> Self:
        """Findings from the fits and tests in `results`, the `decision` on them and
        advised `experiments`, with no description of unexplained residuals.
        """
        known = {field.name: getattr(results, field.name) for field in fields(results)}
        return cls(**known, decision=decision, experiments=experiments)
