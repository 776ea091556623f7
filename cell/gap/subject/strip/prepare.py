"""Prepares measured folds for the gap engine: samples, and corrections for the coarse
rod.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from cell.gap.subject.strip.fold_residuals import FoldResiduals, layout
from cell.gap.subject.strip.measurement_errors import (
    RUN_EFFECTS,
    ModelError,
    RunEffect,
    common_errors,
)
from cell.gap.subject.strip.runs import MeasuredRun
from cell.gap.subject.strip.simulation import (
    COARSE,
    FINE,
    FINER,
    MEDIUM,
    Hashed,
    Job,
    Resolution,
    Simulation,
    hashed_model,
)
from cell.gap.subject.subject import FitRun, Residuals, Samples
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array, frozen
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel, with_field
from drivers.strip.rod.engine import GripperPath

# times the change by a finer rod: how far off another engine or a strip may be
TRUSTED = 2.0
# times the change by a smaller time step: how far off it may be for another model;
# hidden effects change it by 0.2 to 0.4 of itself
STEP_TRUSTED = 0.5
# floors rms over a fold that a finer rod changes: a still finer one decides
DOUBTED = 1.0
# floors: a larger change is no discretisation error but another fold
LARGEST_CHANGE = 20.0
LEAVING_TRAVEL = 0.03  # m of travel in which a strip leaves the desk
STEEP = 0.5  # of its height, by which a grip may be drawn in meanwhile and not push
LATER = 0.6  # s after the measured touch in which the model may still touch
PATH_TOLERANCE = np.array(
    [5e-4, 5e-4, 0.005]
)  # m, m, rad between two paths; arms repeat within a fifth
SAME_START = 1e-3  # s between the beginnings of two paths


class Linearisation(NamedTuple):
    """Derivatives of a fold's residuals near one model of the strip, and the errors
    that its coarse simulation makes in these residuals.

    `grid_error` is the change from a finer rod to that of the fold, `doubt` how far off
    it may be for another model or a real strip; `slopes` are the derivatives by each
    quantity that differs from run to run; `length` [m] of the strip.
    """

    grid_error: Array
    doubt: Array
    slopes: Mapping[str, Array]
    length: float


@dataclass(frozen=True, slots=True)
class PreparedFold:
    """Measured fold that is ready to be compared: its residuals, the paths along which
    it is simulated, and the correction of its coarse simulation.

    The rod has the fold's `resolution`; `linearisation` corrects its residuals. Of a
    replicate, `leader` is the fold whose simulation serves for its responses.

    Pushed along the desk, the strip buckles; where it does is chaotic, because friction
    and grip compliance are unknown. Only strips with bending hysteresis keep the shape;
    they are simulated along `lifted_path`, which has no push. The standard runs lift
    first and never buckle.
    """

    path: Hashed[GripperPath]
    lifted_path: Hashed[GripperPath]
    residuals: FoldResiduals
    linearisation: Linearisation
    resolution: Resolution = COARSE
    leader: "PreparedFold | None" = None

    @property
    def run(self) -> MeasuredRun:
        """Measured fold from which this one was prepared."""
        return self.residuals.run

    @property
    def samples(self) -> Samples:
        """Measured samples of the fold, with their noise, phase and third
        of the strip.
        """
        return self.residuals.layout.samples

    def job(self, hashed: Hashed[StripModel]) -> Job:
        """Simulation of the given strip model along the measured path or, for a strip
        with bending hysteresis, along the path that lifts first.
        """
        has_hysteresis = hashed.value.mechanics.law.yield_curvature > 0.0
        path = self.lifted_path if has_hysteresis else self.path
        height = self.run.contact_height
        model = with_field(hashed.value, "observation.contact_height", height)
        digest = hashed.digest + path.digest + struct.pack("<d", height)
        return Job(
            model=model, path=path.value, resolution=self.resolution, digest=digest
        )

    def correct(
        self, residuals: Residuals, run: FitRun, run_values: Array
    ) -> Residuals:
        """Copy of `residuals` with the error of the coarse simulation removed, moved
        linearly to the run's own unknowns `run_values`.
        """
        mean = residuals.mean - self.linearisation.grid_error
        for p, value in zip(run.local, run_values, strict=True):
            mean = mean + value * self.linearisation.slopes[p.name]
        # E[(r + d)^2]
        return Residuals(mean, residuals.square + mean**2 - residuals.mean**2)


def prepare_runs(
    runs: Sequence[MeasuredRun],
    strip: StripFile,
    simulate: Simulation,
    scatter: Sequence[RunEffect] = RUN_EFFECTS,
) -> list[FitRun]:
    """Runs for a fit from measured folds, without those that have no sample; `scatter`
    lists the quantities that may differ from run to run.
    """
    every = [_fold(run, strip) for run in runs]
    found = [fold for fold in every if len(fold.samples)]
    stated = [hashed_model(describe(strip, index=fold.run.index)) for fold in found]
    folds = _with_leaders(_resolve(found, stated, simulate))
    nominal = [*map(PreparedFold.job, folds, stated)]
    local = tuple(e.parameter for e in scatter)
    linearised = linearise_folds(folds, nominal, simulate, scatter)

    prepared = []
    for fold, about in zip(folds, linearised, strict=True):
        run = fold.run
        repeats = fold.leader is not None
        content = local, fold, run.index
        bare = FitRun(
            run.name, run.condition, fold.samples, *content, replicate=repeats
        )
        prepared.append(relinearise(bare, about))

    return prepared


def linearise_folds(
    folds: Sequence[PreparedFold],
    jobs: Sequence[Job],
    simulate: Simulation,
    scatter: Sequence[RunEffect],
) -> list[Linearisation]:
    """Derivatives of the residuals of each of `folds`, and errors of its coarse
    simulation, about the simulation in `jobs` at the same index.
    """
    pairs = [*zip(folds, jobs, strict=True)]

    # each fold as it is, then with a step in each quantity that scatters
    moved = [
        fold.job(hashed_model(effect.apply(job.model, effect.step)))
        for fold, job in pairs
        for effect in scatter
    ]
    fold_of_moved = [fold for fold in folds for _ in scatter]
    found = iter(_residuals([*folds, *fold_of_moved], [*jobs, *moved], simulate))
    nominal = [*islice(found, len(pairs))]
    grid_errors = _grid_errors(folds, jobs, nominal, simulate)
    step_errors = _grid_errors(
        folds, jobs, residuals=nominal, simulate=simulate, finer=(MEDIUM,)
    )

    linearisations = []
    rows = zip(pairs, nominal, grid_errors, step_errors, strict=True)
    for (fold, job), stated, *errors in rows:
        limit = LARGEST_CHANGE * fold.samples.floor
        grid_error, step_error = (_drop_large(error, limit) for error in errors)
        doubt = np.hypot(TRUSTED * (grid_error - step_error), STEP_TRUSTED * step_error)
        slopes = {
            effect.name: frozen(_drop_large(next(found) - stated, limit) / effect.step)
            for effect in scatter
        }
        length = job.model.mechanics.length
        linearisations.append(
            Linearisation(
                grid_error=frozen(grid_error), doubt=doubt, slopes=slopes, length=length
            )
        )

    return linearisations


def _residuals(
    folds: Sequence[PreparedFold], jobs: Sequence[Job], simulate: Simulation
) -> list[Array]:
    """Residuals of each of `folds` in SI units, one for each sample, against the
    simulation in `jobs` at the same index.
    """
    return [
        fold.residuals(job.model, motion).mean
        for fold, job, motion in zip(folds, jobs, simulate(jobs), strict=True)
    ]


def _resolve(
    folds: Sequence[PreparedFold],
    models: Sequence[Hashed[StripModel]],
    simulate: Simulation,
) -> list[PreparedFold]:
    """Copies of `folds`, of which those get a finer simulated rod whose coarse one errs
    by more than a model is expected to.
    """
    jobs = [*map(PreparedFold.job, folds, models)]
    errors = _grid_errors(
        folds,
        jobs,
        residuals=_residuals(folds, jobs, simulate),
        simulate=simulate,
        finer=(FINE,),
    )
    return [
        replace(fold, resolution=MEDIUM) if _is_doubted(fold, error) else fold
        for fold, error in zip(folds, errors, strict=True)
    ]


def _grid_errors(
    folds: Sequence[PreparedFold],
    jobs: Sequence[Job],
    residuals: Sequence[Array],
    simulate: Simulation,
    finer: Sequence[Resolution] = (FINE, FINER),
) -> list[Array]:
    """Residuals of each fold at its own resolution less those at a `finer` one, in SI
    units, one for each sample.

    Where that is much, the next resolution decides: an end that slips, or a strip that
    is pushed, may take another way at a single one.
    """
    errors = [np.zeros_like(values) for values in residuals]
    doubted = list(range(len(folds)))
    for resolution in finer:
        fine_jobs = [jobs[i]._replace(resolution=resolution) for i in doubted]
        fine = _residuals([folds[i] for i in doubted], fine_jobs, simulate)
        for i, values in zip(doubted, fine, strict=True):
            errors[i] = residuals[i] - values
        doubted = [i for i in doubted if _is_doubted(folds[i], errors[i])]
    return errors


def _is_doubted(fold: PreparedFold, error: Array) -> bool:
    """Whether a finer rod changes the residuals of `fold` so much, by the root mean
    square of `error` over the model's own error, that a finer rod is needed.
    """
    floors = np.nan_to_num(error / fold.samples.floor)
    return bool(floors @ floors > DOUBTED**2 * len(floors))


def _common_errors(
    run: MeasuredRun, samples: Samples, linearisation: Linearisation
) -> dict[str, Array]:
    """Residuals in SI units, one for each sample, that one standard deviation of each
    error common to all runs causes, by the error's name.

    They are those of the model in damping, and of perception where a camera saw the
    run.
    """
    errors = {}
    key = "damping"
    slopes = linearisation.slopes
    if key in slopes:
        errors[key] = frozen(ModelError.shipped().damping * slopes[key])
    if run.plane_error is not None:
        x = np.interp(samples.t, run.t, run.poses[:, 0])
        errors |= common_errors(samples, x < linearisation.length / 2)
    return errors


def relinearise(run: FitRun, about: Linearisation) -> FitRun:
    """Copy of `run` with the derivatives and grid errors in `about`, and with model
    errors enlarged by the doubt about these grid errors.

    A strip with less damping than stated keeps swinging, where grids differ.
    """
    fold: PreparedFold = run.content
    stated = fold.samples.floor
    floor = np.maximum(run.samples.floor, np.hypot(stated, about.doubt))
    samples = replace(run.samples, floor=floor)
    common = _common_errors(fold.run, samples, about)
    return replace(
        run, samples=samples, common=common, content=replace(fold, linearisation=about)
    )


def _drop_large(change: Array, limit: Array) -> Array:
    """Copy of `change` with zeros in place of NaN and of values whose size is beyond
    `limit`, which has the same shape.
    """
    finite = np.nan_to_num(change)
    return np.where(np.abs(finite) < limit, finite, 0.0)


def _fold(run: MeasuredRun, strip: StripFile) -> PreparedFold:
    """Measured fold `run` with its samples and the paths along which it is simulated,
    and with all derivatives and grid errors still zero.
    """
    length = strip.length
    samples_layout = layout(run, length)
    during = run.t <= run.end + LATER
    path = GripperPath(run.t[during], run.poses[during], run.hanging)
    residuals = FoldResiduals(
        run=run,
        layout=samples_layout,
        length=length,
        bending_length=strip.bending_length,
    )
    no_error = np.zeros(len(samples_layout.samples))
    exact = Linearisation(grid_error=no_error, doubt=no_error, slopes={}, length=length)
    lifted = Hashed.of(_lifted_path(path, run))
    return PreparedFold(
        path=Hashed.of(path),
        lifted_path=lifted,
        residuals=residuals,
        linearisation=exact,
    )


def _lifted_path(path: GripperPath, run: MeasuredRun) -> GripperPath:
    """Copy of the measured gripper `path` that rises before it moves inwards, so that
    it pushes no lying strip along the desk.

    A strip lifted by z draws the grip in by about z^2: so does this one, until it joins
    `path`.
    """
    t = path.t
    poses = path.poses.copy()
    travel = run.travel[: len(t)]
    fraction = travel / LEAVING_TRAVEL
    lying = fraction < 1.0
    places = poses[:, :2]
    along, up = interpolate_columns(LEAVING_TRAVEL, travel, places) - places[0]
    pushes_strip = -along > STEEP * up
    if path.hanging or lying.all() or not pushes_strip:
        return path

    x = poses[:, 0]
    start = x[0]
    left = x[~lying][0]
    # with the measured direction in the end
    drawn_in = fraction**2 + (1.0 - fraction) * fraction**8
    x[lying] = start + drawn_in[lying] * (left - start)
    return GripperPath(t, poses)


def _with_leaders(folds: Sequence[PreparedFold]) -> list[PreparedFold]:
    """Copies of `folds` in which each replicate refers to the fold, its leader, whose
    simulation stands for it in responses to effects.

    An effect changes replicates alike, up to far less than the error of a rough time
    step.
    """
    leaders: list[PreparedFold] = []
    leader_of = {}
    for fold in sorted(folds, key=lambda f: -f.path.value.t[-1]):
        leader = next((f for f in leaders if _is_replicate(f, fold)), None)
        if not leader:
            leaders.append(fold)
        leader_of[id(fold)] = leader
    return [replace(fold, leader=leader_of[id(fold)]) for fold in folds]


def _is_replicate(longer: PreparedFold, fold: PreparedFold) -> bool:
    """Whether the path of the fold `longer` is so like that of `fold`, which ends no
    later, that it can be simulated in its place.
    """
    if longer.run.contact_height != fold.run.contact_height:
        return False
    (first, lifted), (second, lifted_too) = (
        (f.path.value, f.lifted_path.value) for f in (longer, fold)
    )
    if first.hanging != second.hanging or abs(first.t[0] - second.t[0]) > SAME_START:
        return False
    return _is_near(first, second) and _is_near(lifted, lifted_too)


def _is_near(longer: GripperPath, path: GripperPath) -> bool:
    """Whether the poses of `path` stay within a tolerance of the poses of `longer` at
    all times.
    """
    expected = interpolate_columns(path.t, longer.t, longer.poses)
    return bool((np.abs(path.poses - expected) < PATH_TOLERANCE).all())
