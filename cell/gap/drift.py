"""Does the specimen change from run to run: base parameters that drift with the run's index."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from cell.gap import lack_of_fit, quadratic
from cell.gap.projection import Projection, projection, stacked
from cell.gap.refit import Estimate
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Drift:
    """Base parameters that change with the index: `words` of the surest one, `p` of them all.

    `removed` is the share of the misfit beyond noise that the drift accounts for, `inflation` by
    channel the scatter between repeats once it is taken out.
    """

    words: str
    p: float
    removed: float
    inflation: dict[str, float]


def drift(estimate: Estimate) -> Drift | None:
    """The drift of the base over the runs, or None where no condition was repeated.

    Likelihood ratio (Wilks 1938) of each parameter linear in the index, all at once, in units of
    the scatter between repeats that is left then.
    """
    runs = estimate.evidence.runs
    conditions = [run.condition for run in runs]
    index = np.array([run.index for run in runs], dtype=float)
    if len(set(conditions)) == len(conditions) or np.ptp(index) == 0.0:
        return None
    about = projection(estimate)
    count = len(estimate.shared)
    owner = np.repeat(np.arange(len(runs)), [len(r) for r in estimate.residuals])
    columns = stacked(estimate)[:, :count] * (index - index.mean())[owner][:, None]
    columns = about.weighed(columns)
    form = about.form(columns)
    free = np.full(count, np.inf)
    limits = quadratic.Bounds(-free, free, np.zeros(count), np.zeros(count))
    rates = quadratic.bounded_step(form, np.zeros(count), limits)
    corrected = (about.residual + about.left(columns) @ rates) / about.weight
    parts = np.split(corrected, np.cumsum([len(r) for r in estimate.residuals])[:-1])
    inflation = lack_of_fit.pure_error(estimate, parts, spent=count)
    unit = max([1.0, *(v / estimate.scale for v in inflation.values())]) ** 2
    p = float(stats.chi2.sf(2.0 * quadratic.decrease(form, rates) / unit, count))
    return Drift(_words(estimate, form, rates), p, _removed(about, corrected), inflation)


def _removed(about: Projection, corrected: Array) -> float:
    """Share of the mean square beyond one that goes with the drift, in weighted units."""
    before = float(np.mean(about.residual**2)) - 1.0
    after = float(np.mean((corrected * about.weight) ** 2)) - 1.0
    return 1.0 if before <= 0.0 else 1.0 - max(after, 0.0) / before


def _words(estimate: Estimate, form: quadratic.Normal, rates: Array) -> str:
    """The parameter of the surest drift, and its change per run."""
    spread = np.sqrt(np.diag(quadratic.covariance(form)))
    i = int(np.argmax(np.abs(rates) / np.maximum(spread, 1e-300)))
    p, value = estimate.model.parameters[i], float(estimate.shared[i])
    if value == 0.0:
        return f"{p.name} changes by {rates[i]:+.2g} {p.unit} a run"
    return f"{p.name} changes by {100 * rates[i] / value:+.2g} % a run"
