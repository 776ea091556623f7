"""Results of an investigation, stage by stage."""

from dataclasses import dataclass

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.lack_of_fit import Bin, Repeats, stronger_of_two
from cell.gap.diagnosis.next_experiment import RatedExperiment, RepeatabilityGain
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.reml import Spread
from cell.gap.selection.choice import Choice
from cell.gap.selection.likelihood import ALPHA, LikelihoodScale
from cell.gap.selection.posterior import Posterior
from cell.gap.selection.screening import ProbeResponses, Score, Table
from cell.gap.subject.subject import Candidate, Subject
from cell.gap.verdict.offered_law import OfferedLaw
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class BaseFit:
    """The refitted base and the tests of its residuals.

    `misfit` is the p-value of the residuals under noise; `weak` are directions that the runs do not
    determine, `scatter` the quantities that differ from run to run; `strained` where the fitted
    values contradict their priors.
    """

    base: CrossValidatedFit
    repeats: Repeats
    misfit: float
    places: tuple[Bin, ...]
    weak: tuple[str, ...]
    scatter: tuple[Spread, ...] = ()
    strained: bool = False

    @property
    def doubted(self) -> bool:
        """Whether the base leaves a gap or contradicts its priors, so that effects are sought."""
        return self.gap or self.strained

    @property
    def gap(self) -> bool:
        """Whether the base leaves more than noise, anywhere, overall or from run to run."""
        seen = self.misfit < ALPHA or any(place.p < ALPHA for place in self.places)
        return seen or self.repeats.drifts or self.repeats.differ


@dataclass(frozen=True, slots=True)
class Screen:
    """Results of the screen: probes, their table, scores of single effects, p-values by name.

    `detectable` are smallest sizes by effect, None where no possible size would show; `library` has
    the whitened response (N, k) to the amount of each effect that fills the floor.
    """

    probed: tuple[ProbeResponses, ...]
    equations: Table
    singles: tuple[Score, ...]
    p: dict[str, float]
    detectable: dict[str, float | None]
    library: dict[str, Array]


@dataclass(frozen=True, slots=True)
class ModelTests:
    """Tests that may cast doubt on the accepted model.

    `misfit` is the p-value of its residuals under noise; `repeats` are compared in its residuals.
    `classes` are effects that the runs do not separate, `scatter` the quantities that differ from
    run to run beside it, `sized` the model fitted with these, from which sizes are estimated.
    `places` are where the accepted effects show in the residuals of the base.
    """

    misfit: float
    repeats: Repeats
    rivals: tuple[CrossValidatedFit, ...]
    classes: tuple[tuple[str, ...], ...]
    sized: Estimate
    scatter: tuple[Spread, ...] = ()
    places: tuple[Bin, ...] = ()

    @property
    def remains(self) -> bool:
        """Whether the accepted model leaves more than noise."""
        return self.misfit < ALPHA


@dataclass(frozen=True, slots=True)
class HeldOutFits:
    """The base and the accepted model on held-out runs, and how much the gap shrinks."""

    before: Estimate
    after: Estimate
    shrink: held_out_gap.Shrink

    @property
    def changed(self) -> bool:
        """Whether an effect was accepted; without one, `after` is `before`."""
        return self.after is not self.before


@dataclass(frozen=True, slots=True)
class Advice:
    """Advice: `experiments`, best per minute first, and the gain of `steadier` quantities."""

    experiments: tuple[RatedExperiment, ...] = ()
    steadier: tuple[RepeatabilityGain, ...] = ()


@dataclass(frozen=True, slots=True)
class Findings:
    """All results of an investigation, stage by stage."""

    subject: Subject
    held_out: tuple[str, ...]
    base_fit: BaseFit
    screen: Screen
    choice: Choice
    posterior: Posterior
    model_tests: ModelTests
    unseen: HeldOutFits
    advice: Advice
    law: OfferedLaw | None = None

    @property
    def base(self) -> CrossValidatedFit:
        """The refitted base."""
        return self.base_fit.base

    @property
    def accepted(self) -> CrossValidatedFit:
        """The accepted model; the base where no effect was accepted."""
        return self.choice.accepted

    @property
    def places(self) -> tuple[Bin, ...]:
        """Bins where the base disagrees, alone or as accepted effects would, strongest first."""
        return tuple(stronger_of_two(self.base_fit.places, self.model_tests.places))

    @property
    def likelihood(self) -> LikelihoodScale:
        """Dispersion and inefficiency by which log-likelihoods of all models are divided."""
        return self.choice.fits.likelihood

    @property
    def separable(self) -> tuple[Candidate, ...]:
        """The accepted effects that the runs separate from all others."""
        doubtful = {name for group in self.model_tests.classes for name in group}
        return tuple(e for e in self.accepted.model.effects if e.name not in doubtful)
