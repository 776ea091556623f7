"""Prepares measured folds for the engine: their samples, and corrections from a finer rod."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.subject.strip.bias import common_errors, half, model_error
from cell.gap.subject.strip.compare import Comparison
from cell.gap.subject.strip.layout import Floors, layout
from cell.gap.subject.strip.runs import Measured, MeasuredRun
from cell.gap.subject.strip.scatter import RUN_EFFECTS, RunEffect
from cell.gap.subject.strip.simulation import (
    FINE,
    FINER,
    HashedModel,
    HashedPath,
    Job,
    Simulation,
)
from cell.gap.subject.subject import Parameter, Residuals, Run, Samples
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.motions import GripperPath
from drivers.types import Array, frozen

TRUSTED = 2.0  # times the change that a finer rod makes: another engine, or a strip, is so far off
DOUBTED = 1.0  # floors rms over a fold that a finer rod changes: a still finer one decides
LARGEST_CHANGE = 20.0  # floors: a larger change is no matter of the grain but of another fold
LEAVING_TRAVEL = 0.03  # m of travel in which a strip leaves the desk
STEEP = 0.5  # of its height, by which a grip may be drawn in meanwhile and not push
LATER = 0.6  # s after the measured touch in which the model may still touch


@dataclass(frozen=True, slots=True)
class Fold:
    """A measured fold: the reported path that drives the model, how it is compared, `index`.

    Pushed along the desk, the strip buckles; where is chaotic, because friction and grip
    compliance are unknown. Only strips with bending hysteresis keep the shape; they are simulated
    along `lifted_path`, which has no push. The standard runs lift first and never buckle.

    Per sample (n,): `finer`, what a finer rod shows more than the coarse one, and `slopes`, what
    the residuals change by per unit of each quantity that differs from run to run.
    """

    way: HashedPath
    lifted_path: HashedPath
    comparison: Comparison
    index: int
    finer: Array
    slopes: Mapping[str, Array]

    def drive(self, hashed: HashedModel) -> Job:
        """The model and path to simulate for this fold."""
        rubs = hashed.model.mechanics.law.yield_curvature > 0.0
        way = self.lifted_path if rubs else self.way
        return Job.of(hashed, way, self.comparison.run.contact_height)

    def correct(self, found: Residuals, run: Run, local: Array) -> Residuals:
        """Residuals corrected to those of a fine rod, in a run with the unknowns `local` (k,)."""
        mean = found.mean - self.finer
        for p, value in zip(run.local, local, strict=True):
            mean = mean + value * self.slopes[p.name]
        return Residuals(mean, found.square + mean**2 - found.mean**2)


def prepare(
    runs: Sequence[MeasuredRun],
    strip: StripFile,
    floors: Floors,
    coarse: Simulation,
    jobs: int,
    scatter: Sequence[RunEffect] = RUN_EFFECTS,
) -> list[Run]:
    """Convert the runs for the engine; runs without a sample are left out.

    `scatter` are the quantities that may differ from run to run.
    """
    folds = [_fold(run.measured, strip, floors) for run in runs]
    nominal = [f.drive(HashedModel.of(describe(strip, index=f.index))) for f in folds]
    about = surroundings(folds, nominal, coarse, jobs, scatter)
    local = tuple(e.parameter for e in scatter)
    return [
        _engine_run(run, fold, here, local)
        for run, fold, here in zip(runs, folds, about, strict=True)
        if len(fold.comparison.layout.samples)
    ]


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Linearisation of one run about a model, per sample (n,): the change by a `finer` rod, and the
    `slopes` by quantity; `length` [m] of the strip.
    """

    finer: Array
    slopes: Mapping[str, Array]
    length: float


def surroundings(
    folds: Sequence[Fold],
    drives: Sequence[Job],
    coarse: Simulation,
    jobs: int,
    scatter: Sequence[RunEffect],
) -> list[Surroundings]:
    """Linearisations about each of `drives`, the models of `folds`."""
    moved = [f.drive(HashedModel.of(e.apply(job.model, e.step)))
             for f, job in zip(folds, drives, strict=True) for e in scatter]  # fmt: skip
    shown = coarse([*drives, *moved])
    about = zip(folds, drives, shown[: len(folds)], strict=True)
    rough = [fold.comparison(job.model, motion).mean for fold, job, motion in about]
    grains = _grid_errors(folds, drives, rough, jobs)
    found = []
    for i, (fold, job) in enumerate(zip(folds, drives, strict=True)):
        limit = LARGEST_CHANGE * fold.comparison.layout.samples.floor
        finer = _drop_large(grains[i], limit)
        slopes = {}
        for k, e in enumerate(scatter, start=i * len(scatter)):
            there = fold.comparison(moved[k].model, shown[len(folds) + k]).mean
            slopes[e.name] = frozen(_drop_large(there - rough[i], limit) / e.step)
        found.append(Surroundings(frozen(finer), slopes, job.model.mechanics.length))
    return found


def _grid_errors(
    folds: Sequence[Fold], drives: Sequence[Job], rough: Sequence[Array], jobs: int
) -> list[Array]:
    """Residuals of the coarse rod, `rough`, less those of a fine one, per sample (n,) of a fold.

    Where that is much, steps half as long decide: an end that slips, or a strip that is pushed,
    may take another way in a single grain.
    """
    floors = [fold.comparison.layout.samples.floor for fold in folds]
    grains = [np.zeros_like(each) for each in rough]
    asked = list(range(len(folds)))
    for resolution in (FINE, FINER):
        exact = Simulation(resolution, jobs)([drives[i] for i in asked])
        for i, motion in zip(asked, exact, strict=True):
            grains[i] = rough[i] - folds[i].comparison(drives[i].model, motion).mean
        asked = [i for i in asked if _rms(grains[i] / floors[i]) > DOUBTED]
    return grains


def _rms(values: Array) -> float:
    """Root mean square of finite values; 0 of a run without samples."""
    return float(np.linalg.norm(np.nan_to_num(values)) / np.sqrt(max(len(values), 1)))


def _engine_run(
    run: MeasuredRun, fold: Fold, about: Surroundings, local: tuple[Parameter, ...]
) -> Run:
    """The run for the engine, linearised about the stated strip."""
    samples = fold.comparison.layout.samples
    samples = replace(samples, floor=np.hypot(samples.floor, TRUSTED * about.finer))
    content = replace(fold, finer=about.finer, slopes=about.slopes)
    common = _common_errors(run.measured, samples, about)
    return Run(run.name, run.condition, samples, local, content, fold.index, common)


def _common_errors(run: Measured, samples: Samples, about: Surroundings) -> dict[str, Array]:
    """Common errors of all runs that a camera recorded, in units of one sigma."""
    if not run.seen:
        return {}
    x = np.interp(samples.t, run.t, run.poses[:, 0])
    halves = np.array([half(place, about.length) for place in x])
    found = common_errors(samples, halves)
    if "damping" in about.slopes:
        found["damping"] = frozen(model_error().damping * about.slopes["damping"])
    return found


def correct(run: Run, fold: Fold, about: Surroundings) -> Run:
    """The run linearised about another model, with a floor for the difference of a finer rod: a
    strip with less damping than stated keeps swinging, where grids differ.
    """
    bare = fold.comparison.layout.samples.floor
    floor = np.maximum(run.samples.floor, np.hypot(bare, TRUSTED * about.finer))
    samples = replace(run.samples, floor=floor)
    content = replace(fold, finer=about.finer, slopes=about.slopes)
    common = _common_errors(fold.comparison.run, samples, about)
    return replace(run, samples=samples, content=content, common=common)


def _drop_large(change: Array, limit: Array) -> Array:
    """`change` (n,), 0 where it is lost or beyond `limit`."""
    known = np.nan_to_num(change)
    return np.where(np.abs(known) < limit, known, 0.0)


def _fold(run: Measured, strip: StripFile, floors: Floors) -> Fold:
    chosen = layout(run, strip.length, floors)
    kept = run.t <= run.end + LATER
    way = GripperPath(run.t[kept], run.poses[kept], run.hanging)
    comparison = Comparison(run, chosen, strip.length, strip.bending_length)
    nothing = np.zeros(len(chosen.samples))
    whole, path = HashedPath.of(way), _lifted_path(way, run)
    lifted = whole if path is way else HashedPath.of(path)
    return Fold(whole, lifted, comparison, run.index, nothing, {})


def _lifted_path(way: GripperPath, run: Measured) -> GripperPath:
    """The measured path, changed to go up before in: the lying strip is never pushed.

    Lifted by z it draws the grip in by about z^2: so does this way, until it joins the measured.
    """
    travel = run.travel[: len(way.t)]
    share = travel / LEAVING_TRAVEL
    early = share < 1.0
    if way.hanging or early.all() or not _pushes_strip(way, travel):
        return way
    poses, begin = way.poses.copy(), way.poses[0, 0]
    drawn = share**2 + (1.0 - share) * share**8  # with the measured direction in the end
    poses[early, 0] = begin + drawn[early] * (poses[~early, 0][0] - begin)
    return GripperPath(way.t, poses)


def _pushes_strip(way: GripperPath, travel: Array) -> bool:
    """Whether the grip moves inwards before the strip has left the desk."""
    moved = [np.interp(LEAVING_TRAVEL, travel, column) - column[0] for column in way.poses.T[:2]]
    return bool(-moved[0] > STEEP * moved[1])
