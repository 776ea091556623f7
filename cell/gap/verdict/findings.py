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
    """Fit of the base parameters to the runs, and tests of its residuals.

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
        """Whether the base leaves more than noise or contradicts its priors."""
        return self.gap or self.strained

    @property
    def gap(self) -> bool:
        """Whether the base leaves more than noise, in a bin, overall or between
        repeats.
        """
        seen = self.misfit < ALPHA or any(place.p < ALPHA for place in self.places)
        return seen or self.repeats.drifts or self.repeats.differ


class Screen(NamedTuple):
    """Results of the linear screen: probe responses of candidate effects, predicted
    gains.

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
    """Tests that may cast doubt on the accepted model.

    `misfit` is the p-value of its residuals under noise; `repeats` are compared in its
    residuals. `classes` are effects that the runs do not separate, `scatter` the
    quantities that differ from run to run beside it, `sized` the model fitted with
    these, from which sizes are estimated. `places` are where the accepted effects show
    in the residuals of the base.
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
        """Whether the accepted model leaves more than noise."""
        return self.misfit < ALPHA


@dataclass(frozen=True, slots=True)
class HeldOutFits:
    """Base and accepted model as fitted to held-out runs, and how much the residual
    shrinks.
    """

    before: FitEstimate
    after: FitEstimate
    shrink: held_out_gap.Shrink

    @property
    def changed(self) -> bool:
        """Whether an effect was accepted; without one, `after` is `before`."""
        return self.after is not self.before

    @property
    def by_key(self) -> dict[str, FitEstimate]:
        """Fits to held-out runs by key: `before` and, where an effect was accepted,
        `after`.
        """
        return {"before": self.before} | ({"after": self.after} if self.changed else {})


@dataclass(frozen=True, slots=True)
class FitResults:
    """Fits and tests of an investigation, by which its verdict is decided.

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
        """Fit problem of the subject."""
        return self.subject.scope

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Displayed quantities by name."""
        return self.scope.quantities

    @property
    def base(self) -> CrossValidatedFit:
        """Refitted base model, without added effects."""
        return self.base_fit.base

    @property
    def places(self) -> Sequence[Bin]:
        """Bins where residuals of the base exceed noise or match accepted effects, by
        strength.
        """
        return stronger_of_two(self.base_fit.places, self.model_tests.places)

    @property
    def likelihood(self) -> LikelihoodScale:
        """Dispersion and inefficiency by which log-likelihoods of all models are
        divided.
        """
        return self.fits.likelihood

    @property
    def separable(self) -> list[Candidate]:
        """Accepted effects that the runs tell apart from all others."""
        doubtful = {name for group in self.model_tests.classes for name in group}
        return [
            effect for effect in self.accepted.effects if effect.name not in doubtful
        ]


class DecidedVerdict(NamedTuple):
    """Decided verdict on the accepted model, and what it rests on.

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
    """All results of an investigation of a subject, with the decision on them.

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
        """Findings with the `decision` on `results`, without a law."""
        known = {field.name: getattr(results, field.name) for field in fields(results)}
        return cls(**known, decision=decision, experiments=experiments)
