"""Lack of fit: whether residuals exceed noise, between repeats, overall, and in which
places.

N is the number of samples of all runs, stacked run by run.
"""

from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self, TypeVar

import numpy as np
from scipy import special
from scipy.stats import rankdata

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.base_fit import projection
from cell.gap.fitting.crossvalidation import settled_response
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.normal_equations import NormalEquations
from cell.gap.selection.likelihood import ALPHA
from cell.gap.subject.subject import FitRun
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

K = TypeVar("K", bound=Hashable)
Place = tuple[str, str, str, str]
"""Channel, phase, zone and condition of a sample."""
FEWEST_SAMPLES = 4  # samples that make a bin; set by hand
UNSTEADY = 3.0  # times the stated noise by which repeats may differ; set by hand
# s of a bin in which repeats are compared: as long as the samples of a strip
BIN_TIME = 0.3
DRAWS = 400  # of the noise; set by hand
ORDERS = 4000  # of runs, shuffled; set by hand
ROUNDING = 1e-9  # of a correlation
FEWEST_ORDERED = 6  # runs: of fewer, no order is rarer than one of a hundred
OTHERS = 0.01  # of a run's weight, that of others in a fit to it
SUSPECTED = 0.02  # p-value; of six runs in a row two neighbours may be exchanged


class Repeats(NamedTuple):
    """Scatter between repeated runs of one condition, for each channel, in units of the
    stated noise.

    `scatter` between repeats, and `inflation` of the noise once a drift of the shared
    parameters with the index of the run is taken out. `drift` says in words which
    parameter drifts most surely, `p` is the p-value of no drift; empty and 1 where no
    condition was repeated.
    """

    scatter: dict[str, float]
    inflation: dict[str, float]
    drift: str = ""
    p: float = 1.0

    @classmethod
    def of(cls, estimate: FitEstimate) -> Self:
        """Compare the repeated runs of `estimate`, and test whether shared
        parameters drift from run to run.

        Likelihood ratio (Wilks 1938) of each parameter linear in the index, all at
        once, in units of the scatter between repeats that is left then. Only repeats
        are held against each other: what the model gets wrong of a condition is the
        same in all of them.
        """
        runs = estimate.runs
        scatter = _pure_error(estimate, estimate.residuals)
        later = _relative_index(runs)
        if not later.any():
            return cls(scatter, scatter)

        about = projection(estimate)
        count = len(estimate.shared)
        owner = np.repeat(np.arange(len(runs)), [len(r) for r in estimate.residuals])
        columns = about.weigh(
            estimate.stacked_jacobian[:, :count] * later[owner][:, None]
        )
        form = about.form(columns)
        free = np.full(count, np.inf)
        rates = form.bounded_step(-free, free)
        corrected = (about.residual + about.unabsorbed(columns) @ rates) / about.weight
        inflation = _pure_error(estimate, estimate.by_run(corrected), spent=count)
        unit = max([1.0, *(v / estimate.scale for v in inflation.values())]) ** 2
        p = special.chdtrc(count, 2.0 * form.decrease(rates) / unit)
        return cls(
            scatter=scatter,
            inflation=inflation,
            drift=_drift_words(estimate, form),
            p=p,
        )

    @property
    def differ(self) -> bool:
        """Whether repeated runs differ by more than UNSTEADY times the stated noise
        once a drift is taken out.
        """
        return max(self.inflation.values(), default=1.0) > UNSTEADY

    @property
    def drifts(self) -> bool:
        """Whether repeated runs differ beyond noise because shared parameters drift
        from run to run.
        """
        return self.p < ALPHA and max(self.scatter.values(), default=1.0) > 1.0


def _pure_error(
    estimate: FitEstimate, residuals: Sequence[Array], spent: int = 0
) -> dict[str, float]:
    """Factor (>= 1) on the noise of each channel that explains the scatter between
    repeats.

    `residuals` (n,) by run of the runs of `estimate`; `spent` degrees of freedom went
    into them. Variance of bin means between runs of one condition over what the noise
    explains, accepted where its chi-square probability is below ALPHA (Draper and
    Smith, Applied Regression Analysis, lack of fit and pure error).
    """
    squares: dict[str, float] = defaultdict(float)
    freedom: dict[str, int] = defaultdict(int)
    for channel, (mean, count) in _repeated_bins(estimate, residuals):
        about = mean - np.average(mean, weights=count)
        squares[channel] += count @ about**2
        freedom[channel] += len(mean) - 1

    factors = {}
    for channel, square in squares.items():
        left = max(1, freedom[channel] - spent)
        excess = special.chdtrc(left, square) < ALPHA
        factors[channel] = max(1.0, np.sqrt(square / left)) if excess else 1.0
    return factors


def _repeated_bins(
    estimate: FitEstimate, residuals: Sequence[Array]
) -> Iterator[tuple[str, Array]]:
    """Yield the channel, and the mean residuals and sample counts (2, k), of each time
    bin that k > 1 repeated runs share.
    """
    bins: dict[tuple[Place, int], list[tuple[float, int]]] = defaultdict(list)
    for run, r in zip(estimate.runs, residuals, strict=True):
        times = (run.samples.t / BIN_TIME).astype(int)
        members = _rows_by(zip(_places(run), times, strict=True))
        for time_bin, rows in members.items():
            bins[time_bin].append((r[rows].mean(), len(rows)))

    for (place, _), by_run in bins.items():
        if len(by_run) > 1:
            channel, *_ = place
            yield channel, np.array(by_run).T


def _relative_index(runs: Sequence[FitRun]) -> Array:
    """Index (runs,) of each run in the order of measurement, less its mean over the
    repeats of the run's condition.
    """
    index = np.array([run.index for run in runs], dtype=float)
    for rows in _rows_by(run.condition for run in runs).values():
        index[rows] -= index[rows].mean()
    return index


def _drift_words(estimate: FitEstimate, form: NormalEquations) -> str:
    """Sentence on the shared parameter whose linear drift explains the repeats' scatter
    best, with its change per run.
    """
    gradient = form.gradient
    information = np.maximum(np.diag(form.curvature), 1e-300)
    i = np.argmax(gradient**2 / information)
    rate = -gradient[i] / information[i]
    value = estimate.shared[i]
    p = estimate.model.parameters[i]
    size = f"{100 * rate / value:+.2g} %" if value else f"{rate:+.2g} {p.unit}"
    return f"{p.name} changes by {size} a run"


def _places(run: FitRun) -> Iterator[Place]:
    """Place (channel, phase, zone, condition) of each sample of `run`."""
    s = run.samples
    for channel, phase, zone in zip(s.channel, s.phase, s.zone, strict=True):
        yield str(channel), str(phase), str(zone), run.condition


def _rows_by(keys: Iterable[K]) -> dict[K, list[int]]:
    """Positions in `keys` at which each distinct key stands, by key."""
    rows: dict[K, list[int]] = defaultdict(list)
    for i, key in enumerate(keys):
        rows[key].append(i)
    return rows


@dataclass(frozen=True, slots=True)
class Bin:
    """Test of the residuals in a bin of samples: statistic `z` [sigma], family-wise
    p-value `p`.

    `z` is the stronger of the signed mean (with its sign) and the energy.
    """

    channel: str
    phase: str
    zone: str
    condition: str
    z: float
    p: float

    @property
    def place(self) -> Place:
        """Channel, phase, zone and condition of the bin's samples."""
        return self.channel, self.phase, self.zone, self.condition


class ResidualTest(NamedTuple):
    """Test of a fit's residuals (samples,) against those that measurement noise and
    run-to-run variation would leave.

    `noise` (N, draws) are draws of these; the residuals are divided by what is
    `allowed` (N,) first, the factor on the noise of a sample's channel that its
    `repeats` demand. In probabilities an outlier counts as much as the fit lets it
    count.
    """

    estimate: FitEstimate
    repeats: Repeats
    noise: Array
    allowed: Array

    @classmethod
    def of(cls, estimate: FitEstimate, rng: np.random.Generator) -> Self:
        """Test of the residuals of `estimate`, with noise drawn from `rng`."""
        repeats = Repeats.of(estimate)
        channels = [str(c) for run in estimate.runs for c in run.samples.channel]
        allowed = np.array(
            [repeats.inflation.get(channel, 1.0) for channel in channels]
        )
        return cls(
            estimate=estimate,
            repeats=repeats,
            noise=_draw_residuals(estimate, rng),
            allowed=allowed,
        )

    @property
    def bins(self) -> dict[Place, list[int]]:
        """Row numbers of the samples in each bin (channel, phase, zone, condition);
        bins with few samples are left out.
        """
        rows = _rows_by(self._places).items()
        return {place: some for place, some in rows if len(some) >= FEWEST_SAMPLES}

    @property
    def _residuals(self) -> Array:
        """Whitened residuals (samples,) of the fit, divided by the noise factor allowed
        for each sample.
        """
        return self.estimate.stacked_residuals / self.allowed

    @property
    def _places(self) -> Iterator[Place]:
        return (place for run in self.estimate.runs for place in _places(run))

    def misfit(self) -> float:
        """p-value of the largest mean square residual over channels and conditions.

        Mean squares are standardised by those of the noise draws.
        """
        clipped = robust.clip_residuals(self._residuals)
        places = ((channel, condition) for channel, *_, condition in self._places)
        rows = _rows_by(places).values()
        observed, drawn = (
            np.array([np.mean(squares[i], axis=0) for i in rows])
            for squares in (clipped**2, self.noise**2)
        )
        largest_drawn = _standardise(drawn.T, drawn).max(axis=1)
        return _tail(largest_drawn, _standardise(observed, drawn).max())

    def test_bins(self) -> list[Bin]:
        """Test each bin for residuals beyond noise; returns all bins, the strongest
        first.

        Signed mean and energy of each bin, the latter as sqrt(2 chi^2), which is nearly
        normal (Fisher 1925), both standardised by the noise draws. `z` is of the
        residuals as they are, `p` of residuals clipped as in the fit, by the largest
        statistic of all bins in each draw (Westfall and Young 1993, single-step max-T).
        """
        residuals = self._residuals
        bins = self.bins
        rows = list(bins.values())
        drawn = _sum_and_energy(self.noise, rows)

        def strongest(r: Array) -> Array:
            pairs = zip(_sum_and_energy(r, rows), drawn, strict=True)
            signed, energy = (_standardise(values, draws) for values, draws in pairs)
            return np.where(np.abs(signed) >= energy, signed, energy)

        signed, energy = (_standardise(draws.T, draws).T for draws in drawn)
        null = np.maximum(np.abs(signed).max(axis=0), energy.max(axis=0))
        clipped = strongest(robust.clip_residuals(residuals))
        tested = [
            Bin(*place, float(z), _tail(null, abs(z_clipped)))
            for place, z, z_clipped in zip(
                bins, strongest(residuals), clipped, strict=True
            )
        ]
        return sorted(tested, key=lambda each: -abs(each.z))

    def matching(self, fitted: FitEstimate, others: Sequence[FitEstimate]) -> list[Bin]:
        """Test in each bin how well the residuals match what the effects of the model
        `fitted` would change; surest bin first.

        Each sample counts by what that model predicts otherwise than this one (matched
        filter). It was chosen in sight of the residuals, so that a draw counts by its
        strongest bin under the response of any of the models tried, it and `others`,
        with either sign (Westfall and Young 1993).
        """
        residuals = self._residuals
        allowed = self.allowed
        bins = self.bins
        clipped = robust.clip_residuals(residuals)
        rows = list(bins.values())
        responses = [
            residuals - model.stacked_residuals / allowed for model in (fitted, *others)
        ]
        sums = [
            _match_sums(clipped, response, rows, self.noise) for response in responses
        ]
        observed, _ = sums[0]
        own = responses[0]
        largest = np.max([np.abs(drawn).max(axis=0) for _, drawn in sums], axis=0)

        matched = []
        for (place, samples), z in zip(bins.items(), observed, strict=True):
            side = 1.0 if own[samples].sum() >= 0.0 else -1.0
            matched.append(Bin(*place, side * float(z), _tail(largest, z)))

        return sorted(matched, key=lambda each: (each.p, -abs(each.z)))


def _draw_residuals(estimate: FitEstimate, rng: np.random.Generator) -> Array:
    """Random whitened residuals (N, DRAWS) [noise] as a fit of the true model would
    leave them.

    Noise and run-to-run scatter, less what the fit absorbs of them: parametric
    bootstrap of the linearised model (Davison and Hinkley 1997, section 6.3).
    """
    linearised = projection(estimate, robustly=False)
    samples, sources = linearised.scatter.shape
    noise = rng.standard_normal((samples, DRAWS))
    noise += linearised.scatter @ rng.standard_normal((sources, DRAWS))
    return linearised.unabsorbed(noise)


def _tail(drawn: Array, observed: float) -> float:
    """p-value: share of draws (draws,) of a statistic that are at least as large as
    `observed`.
    """
    return (1.0 + float((drawn >= observed).sum())) / (1.0 + len(drawn))


def _sum_and_energy(residuals: Array, rows: Sequence[list[int]]) -> tuple[Array, Array]:
    """Sums (bins, ...) of residuals (samples, ...) over the samples of each bin, and
    sqrt(2 sum of squares) (bins, ...).
    """
    sums, squares = (
        np.array([values[i].sum(axis=0) for i in rows])
        for values in (residuals, residuals**2)
    )
    return sums, np.sqrt(2.0 * squares)


def _match_sums(
    r: Array, weight: Array, rows: Sequence[list[int]], noise: Array
) -> tuple[Array, Array]:
    """Sums (bins,) of residuals `r` (samples,) and (bins, draws) of `noise` (samples,
    draws), weighted and standardised by the noise draws.
    """
    drawn = np.array([weight[members] @ noise[members] for members in rows])
    observed = np.array([r[members] @ weight[members] for members in rows])
    return _standardise(observed, drawn), _standardise(drawn.T, drawn).T


def _standardise(values: Array, drawn: Array) -> Array:
    """Convert statistics (..., k) to standard deviations from the mean of their k rows
    of random draws `drawn` (k, draws).
    """
    standard: Array = (values - drawn.mean(axis=1)) / (drawn.std(axis=1) + 1e-12)
    return standard


def stronger_of_two(by_itself: Sequence[Bin], by_effect: Sequence[Bin]) -> list[Bin]:
    """Bins with the smaller p-value of two tests, doubled because the better of two was
    chosen; strongest bin first.
    """
    if not by_effect:
        return list(by_itself)
    other = {b.place: b for b in by_effect}
    surer = [min(b, other[b.place], key=lambda one: one.p) for b in by_itself]
    corrected = [replace(b, p=min(1.0, 2.0 * b.p)) for b in surer]
    return sorted(corrected, key=lambda each: -abs(each.z))


def can_be_ordered(runs: Sequence[FitRun]) -> bool:
    """Whether enough runs state when they were taken to test values for their order."""
    return len({run.index for run in runs}) >= FEWEST_ORDERED


def order_suspicion(estimate: FitEstimate, rng: np.random.Generator) -> str:
    """Sentence on values that change with the order in which the runs were taken; empty
    if none does.

    Of each run follow the values of shared parameters, by a step of the fit towards it,
    and its own random unknowns. The strongest of their rank correlations with the order
    (Spearman 1904) but one is held against those of shuffled orders: one value alone
    that happens to follow the order is no proof.
    """
    runs = estimate.runs
    if not can_be_ordered(runs):
        return ""

    parameters, values = _values_by_run(estimate)
    order = _ranks(np.array([run.index for run in runs]))
    ranks = _ranks(values)
    shuffled = np.array([rng.permutation(order) for _ in range(ORDERS)])
    follow = order @ ranks
    k = np.argmax(np.abs(follow))
    others = np.arange(len(follow)) != k if len(follow) > 1 else [k]
    chance = np.abs(shuffled @ ranks[:, others]).max(axis=1)
    p = _tail(chance, np.abs(follow[others]).max() - ROUNDING)
    if p >= SUSPECTED:
        return ""

    moves = "rises" if follow[k] > 0.0 else "falls"
    return (
        f"values change with the order of the runs (p {p:.1g}), most surely"
        f" {parameters[k].name} {moves}: what warms, wears or ages? make the first"
        " motion again at the end"
    )


def _values_by_run(estimate: FitEstimate) -> tuple[list[Parameter], Array]:
    """Parameters (k,) that all runs share or each run draws anew, and their values
    (runs, k) fitted to each run by itself.
    """
    runs = estimate.runs
    scale = estimate.scale
    random = [p for p in runs[0].local if p.random]
    responses = [settled_response(estimate, i) for i in range(len(runs))]
    squares = [response.T @ response for response in responses]
    others = OTHERS * sum(squares) / len(runs)

    values = []
    for i, (run, response) in enumerate(zip(runs, responses, strict=True)):
        # a step of the fit towards this run
        r = robust.clip_residuals(estimate.residuals[i] / scale)
        covariance = normal_equations.covariance(squares[i] + others)
        step = covariance @ (response.T @ r)

        own = dict(zip((p.name for p in run.local), estimate.local[i], strict=True))
        drawn = [own[p.name] for p in random]
        values.append(np.append(estimate.shared - scale * step, drawn))

    return [*estimate.model.parameters, *random], np.array(values)


def _ranks(values: Array) -> Array:
    """Ranks within each column of `values` (n, k), centred on zero and scaled to unit
    length.
    """
    ranks: Array = rankdata(values, axis=0) - 0.5 * (len(values) + 1)
    ranks /= np.linalg.norm(ranks, axis=0)
    return ranks
