"""Differences of repeats, and whether the specimen changes with the number of the run."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import special

from cell.gap.diagnosis.lack_of_fit import pure_error
from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import projection, stacked_jacobian
from cell.gap.selection.likelihood import ALPHA
from cell.gap.subject.subject import Run
from drivers.types import Array

UNSTEADY = 3.0  # times the stated noise by which repeats may differ; set by hand


@dataclass(frozen=True, slots=True)
class Drift:
    """Test for base parameters that change with the run index: p-value `p`, the surest in `words`.

    By channel, in units of the noise: `scatter` between repeats, `inflation` once the drift is
    taken out of them.
    """

    words: str
    p: float
    scatter: dict[str, float]
    inflation: dict[str, float]

    @property
    def real(self) -> bool:
        """Whether repeats differ by more than noise, and by a drift."""
        return self.p < ALPHA and max(self.scatter.values(), default=1.0) > 1.0


@dataclass(frozen=True, slots=True)
class Repeats:
    """Differences of repeats: their `drift` (None without any), noise `inflation` by channel."""

    drift: Drift | None
    inflation: dict[str, float]

    @classmethod
    def of(cls, estimate: Estimate) -> Self:
        """Compare the repeats in a fit; a drift does not count in their noise."""
        change = drift(estimate)
        return cls(change, pure_error(estimate) if change is None else change.inflation)

    @property
    def differ(self) -> bool:
        """Whether repeats differ, drift aside, by more than UNSTEADY times the stated noise."""
        return max(self.inflation.values(), default=1.0) > UNSTEADY

    @property
    def drifts(self) -> bool:
        """Whether the specimen changes from run to run as the model does not predict."""
        return self.drift is not None and self.drift.real


def drift(estimate: Estimate) -> Drift | None:
    """The drift of the base between repeats, or None where no condition was repeated.

    Likelihood ratio (Wilks 1938) of each parameter linear in the index, all at once, in units of
    the scatter between repeats that is left then. Only repeats are held against each other: what
    the model gets wrong of a condition is the same in all of them.
    """
    runs = estimate.evidence.runs
    later = _relative_index(runs)
    if not later.any():
        return None
    about = projection(estimate)
    count = len(estimate.shared)
    owner = np.repeat(np.arange(len(runs)), [len(r) for r in estimate.residuals])
    columns = about.weigh(stacked_jacobian(estimate)[:, :count] * later[owner][:, None])
    form = about.form(columns)
    nothing, free = np.zeros(count), np.full(count, np.inf)
    limits = normal_equations.Bounds(-free, free, nothing, nothing)
    rates = normal_equations.bounded_step(form, nothing, limits)
    corrected = (about.residual + about.left(columns) @ rates) / about.weight
    parts = np.split(corrected, np.cumsum([len(r) for r in estimate.residuals])[:-1])
    inflation = pure_error(estimate, parts, spent=count)
    unit = max([1.0, *(v / estimate.scale for v in inflation.values())]) ** 2
    p = float(special.chdtrc(count, 2.0 * normal_equations.decrease(form, rates) / unit))
    return Drift(_words(estimate, form), p, pure_error(estimate), inflation)


def _relative_index(runs: Sequence[Run]) -> Array:
    """Index (R,) of each run less the mean index of the runs of its condition."""
    index = np.array([run.index for run in runs], dtype=float)
    condition = np.array([run.condition for run in runs])
    return np.asarray(index - np.array([index[condition == own].mean() for own in condition]))


def _words(estimate: Estimate, form: normal_equations.Normal) -> str:
    """Words for the parameter whose drift alone explains most, and its change per run."""
    information = np.maximum(np.diag(form.curvature), 1e-300)
    i = int(np.argmax(form.gradient**2 / information))
    rate = -form.gradient[i] / information[i]
    p, value = estimate.model.parameters[i], float(estimate.shared[i])
    if value == 0.0:
        return f"{p.name} changes by {rate:+.2g} {p.unit} a run"
    return f"{p.name} changes by {100 * rate / value:+.2g} % a run"
