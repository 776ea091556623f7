"""Strip as a subject of the gap engine: measured folds compared with simulated ones."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.strip.fold_residuals import FoldResiduals, simulated_touch
from cell.gap.subject.strip.measurement_errors import (
    FORCE_EFFECTS,
    RUN_EFFECTS,
    RunEffect,
)
from cell.gap.subject.strip.midline_residuals import interpolate_midlines
from cell.gap.subject.strip.prepare import (
    PreparedFold,
    linearise_folds,
    prepare_runs,
    relinearise,
)
from cell.gap.subject.strip.runs import MeasuredRun, read_runs
from cell.gap.subject.strip.scope import fitted_strip, scope
from cell.gap.subject.strip.simulation import (
    Hashed,
    Job,
    SimulatedMotion,
    Simulation,
    hashed_model,
)
from cell.gap.subject.strip.synthetic import SET_UP, instruction, planned_runs
from cell.gap.subject.subject import (
    NO_FILE,
    Curve,
    Experiment,
    Finding,
    FitRun,
    NamedValues,
    Origin,
    Residuals,
    Scene,
    SimulationRequest,
    Subject,
    TimeSeries,
    Track,
    note_of,
)
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array
from drivers.strip.describe import describe, load_strip
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Parameter
from drivers.strip.engine import Touch
from drivers.strip.file import StripFile
from drivers.strip.law import LAW_TERMS, with_law
from drivers.strip.model import ObservationModel, StripModel
from drivers.strip.observation import imaged_time, measured_contact, measured_points

DIGITS = 6  # significant digits of a fitted number
# of the contacts of a run that may lie before its lift-off, as outliers
QUANTILE = 0.02
DESCRIBED = 256  # models that are kept
# sigma, and times those of the other way, of l1 and l2 swapped
SWAPPED, FARTHER = 5.0, 2.0
PORTION = 64  # motions that are held at once
AGEING = frozenset({"ageing", "term_run"})
"""Effects and terms that depend on the number of the run: all others share one
description.
"""
Values = tuple[float, ...]


def patch_file(
    strip: StripFile,
    base: Mapping[str, float],
    effects: NamedValues,
    source: str,
) -> tuple[dict[str, object], dict[str, object] | None]:
    """Content of the strip file with fitted values and the given effects of the strip,
    and the content of the cell file's patch, or None where no effect belongs to the
    cell.
    """
    content: dict[str, Any] = strip.model_dump(
        mode="json", by_alias=True, exclude_unset=True
    )
    notes = content.pop("provenance", [])
    law = content.pop("law", {})
    of_strip = content.setdefault("effects", {})
    of_cell: dict[str, object] = {}

    for name, value in base.items():
        effect, _, key = name.rpartition(".")
        stated = of_strip[effect] if effect else content
        path = f"effects.{name}" if effect else name
        notes.append(note_of(path, stated.get(key), source))
        stated[key] = _round_off(value)

    for name, values in effects.items():
        rounded = {key: _round_off(value) for key, value in values.items()}
        if name in LAW_TERMS:
            old = law.get(name)
            remark = "; a description, no cause"
            notes.append(note_of(f"law.{name}", old, source, remark))
            law[name] = _round_off((old or 0.0) + values["amount"])
        elif registry()[name].of == "cell":
            of_cell[name] = rounded
        else:
            notes.append(note_of(f"effects.{name}", None, source))
            of_strip[name] = rounded

    if law:
        content["law"] = law
    content["provenance"] = notes
    return content, {"schema": 1, "effects": of_cell} if of_cell else None


def _round_off(value: float) -> float:
    """Copy of the number `value`, rounded to the few digits that a fit can
    determine.
    """
    return float(f"{value:.{DIGITS}g}")


class ResidualKey(NamedTuple):
    """Key under which residuals are kept in memory: the measured fold, the digest of
    the simulated motion, and how sensors observe it.
    """

    residuals: FoldResiduals
    motion: bytes
    observation: ObservationModel


class StripSubject(Subject):
    """Measured folds of one strip, as a fit compares them: each is simulated as an
    elastic rod along the measured gripper path.

    `notes` warn the operator of incomplete runs.
    """

    kind = "strip"

    def __init__(
        self,
        strip: StripFile,
        runs: Sequence[MeasuredRun],
        jobs: int = 1,
        without: Sequence[str] = (),
        scatter: Sequence[RunEffect] = RUN_EFFECTS,
        origin: Origin = NO_FILE,
    ) -> None:
        """Prepare the measured folds `runs` of `strip` for fits, in which the effects
        named in `without` are not tried.

        `scatter` are the quantities that may differ from run to run.
        """
        self.origin = origin
        self.file = strip
        self.name = strip.name
        self._threads = jobs
        self.notes = tuple(note for run in runs for note in run.notes)
        measured = self._measured = tuple(run for run in runs if run.usable)
        has_force = any(run.has_force for run in measured)
        contacts = [run.contact_x for run in measured if len(run.contact_x)]
        # m, beyond which the strip lifts off the desk; 0 where no image shows it
        lifted = min((np.quantile(x, QUANTILE) for x in contacts), default=0.0)
        self.scope = scope(strip, lifted, has_force=has_force).withhold(
            without, registry()
        )
        self._scatter = (*scatter, *(FORCE_EFFECTS if has_force else ()))
        self._ages = not AGEING.isdisjoint({*strip.effects, *strip.law})
        self._simulation = Simulation(jobs)
        self._residual_cache: dict[ResidualKey, Residuals] = {}
        self._model_cache = lru_cache(DESCRIBED)(
            partial(_describe, strip, self.scope.base)
        )
        self.runs = prepare_runs(measured, strip, self._simulation, self._scatter)

    def simulate(self, requests: Sequence[SimulationRequest]) -> list[Residuals]:
        """Residuals for each of `requests`, measured minus simulated; a motion that
        several requests share is simulated once.
        """
        folds, jobs = self._jobs_of(requests)
        keys = [
            ResidualKey(fold.residuals, job.key, job.model.observation)
            for fold, job in zip(folds, jobs, strict=True)
        ]
        cache = self._residual_cache
        asked = dict(zip(keys, jobs, strict=True))
        missing = {key: job for key, job in asked.items() if key not in cache}
        cache.update(self._compare(missing))
        return [
            fold.correct(cache[key], request.run, request.local)
            for request, fold, key in zip(requests, folds, keys, strict=True)
        ]

    def contradictions(self) -> Iterator[Finding]:
        """Yield a finding where the two lengths measured at the touch of the layers
        seem to be swapped, because swapped ones agree far better with the stated strip.
        """
        simulated = self.simulate([self.stated(run) for run in self.runs])
        errors = [*map(_touch_errors, self.runs, simulated)]
        off = np.concatenate(errors)
        if not len(off):
            return
        stated, swapped = np.sqrt(np.mean(off**2, axis=0))
        if stated > max(SWAPPED, FARTHER * swapped):
            yield Finding(
                what="swapped columns",
                words=(
                    f"l1 and l2 of the touches: the stated strip is {stated:.0f} sigma"
                    f" off their displacements, and {swapped:.1f} if they are swapped"
                ),
                remedy="look whether the columns are the right way round",
            )

    def _compare(self, jobs: Mapping[ResidualKey, Job]) -> dict[ResidualKey, Residuals]:
        """Simulate `jobs` and compare them with their measured folds, in portions of
        similar duration; returns residuals by key.

        Keys of one motion stay together, in the order in which they are requested;
        motions are not kept.
        """
        first: dict[bytes, int] = {}
        for i, key in enumerate(jobs):
            first.setdefault(key.motion, i)

        keys = iter(
            sorted(jobs, key=lambda k: (jobs[k].path.duration, first[k.motion]))
        )
        compared: dict[ResidualKey, Residuals] = {}
        with ThreadPoolExecutor(self._threads) as pool:
            while portion := list(islice(keys, PORTION)):
                motions = self._simulation([jobs[key] for key in portion])
                residuals = pool.map(
                    lambda key, motion: key.residuals(jobs[key].model, motion),
                    portion,
                    motions,
                )
                compared.update(zip(portion, residuals, strict=True))

        return compared

    def draw_measured(self, run: FitRun) -> Scene:
        """Drawing of the measured fold of `run`."""
        return _measured_scene(run.content.run)

    def draw_simulated(
        self, requests: Sequence[SimulationRequest]
    ) -> list[Scene | None]:
        """Drawings of the simulated folds, one for each request; None where the strip
        cannot be simulated.
        """
        folds, jobs = self._jobs_of(requests)
        rows = zip(folds, jobs, self._simulation(jobs), strict=True)
        return [
            _simulated_scene(fold, job.model, motion) if motion else None
            for fold, job, motion in rows
        ]

    def refine(self, requests: Sequence[SimulationRequest]) -> Sequence[FitRun]:
        """Copies of the runs of `requests` with derivatives about the requested models,
        and corrections from a finer simulated rod.
        """
        folds, jobs = self._jobs_of(requests)
        linearised = linearise_folds(folds, jobs, self._simulation, self._scatter)
        return [
            relinearise(request.run, about)
            for request, about in zip(requests, linearised, strict=True)
        ]

    def experiments(self) -> Sequence[Experiment]:
        """Runs with the standard motions that could be made next, each simulated with
        the strip as its file states it.
        """
        strip = self.file
        measured = self._measured
        next_index = 1 + max(run.index for run in measured)
        runs = planned_runs(strip, measured[0].sigma, next_index)
        ready = prepare_runs(runs, strip, self._simulation)
        planned = [(run, run.content.run) for run in ready]
        return [
            Experiment(
                name=run.name,
                instruction=instruction(fold),
                minutes=SET_UP + fold.end / 60.0,
                run=run,
            )
            for run, fold in planned
        ]

    def patch(
        self, base: Mapping[str, float], effects: NamedValues, source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """Content of the strip file with fitted values and effects, and the patch of
        the cell file, None where no effect belongs to the cell.
        """
        return patch_file(self.file, base, effects, source)

    def _jobs_of(
        self, requests: Sequence[SimulationRequest]
    ) -> tuple[list[PreparedFold], list[Job]]:
        """Measured folds of `requests`, and the simulation to run for each of them.

        For a response, one fold is simulated that stands for all its replicates.
        """
        folds = [request.run.content for request in requests]
        jobs = [
            ((request.response and fold.leader) or fold).job(self._model(request))
            for request, fold in zip(requests, folds, strict=True)
        ]
        return folds, jobs

    def _model(self, request: SimulationRequest) -> Hashed[StripModel]:
        """Model of the strip for a request, kept in memory; earlier runs matter to it
        only where an effect ages the strip.
        """
        effects = tuple(
            (name, tuple(map(float, v))) for name, v in request.effects.items()
        )
        ages = self._ages or not AGEING.isdisjoint(request.effects)
        index = request.run.index if ages else 0
        return self._model_cache(tuple(map(float, request.base)), effects, index)


def _describe(
    strip: StripFile,
    parameters: Sequence[Parameter],
    base: Values,
    effects: tuple[tuple[str, Values], ...],
    index: int,
) -> Hashed[StripModel]:
    """Model of `strip` in the run numbered `index`, with the values `base` of
    `parameters` and with the added `effects`.
    """
    values = {p.name: p.stated_value(v) for p, v in zip(parameters, base, strict=True)}
    known = registry()
    stated = {n: known[n].stated(vector) for n, vector in effects if n in known}
    present = {name: given for name, given in stated.items() if given is not None}
    model = describe(fitted_strip(strip, values), present, index)
    # of law terms; others are ignored
    amounts = {name: vector[0] for name, vector in effects}
    return hashed_model(with_law(model, amounts))


def _touch_errors(run: FitRun, residuals: Residuals) -> Array:
    """Errors of a simulation in the displacement at the touch, in standard deviations:
    a row with the error as measured and the one with the two lengths swapped.
    """
    touch = run.content.run.touch
    samples = run.samples
    if not touch:
        return np.empty((0, 2))
    off = residuals.mean
    errors = np.array([off, off - 2.0 * touch.displacement]) / samples.scale
    rows = (samples.quantity == "displacement") & np.isfinite(off)
    compared: Array = errors.T[rows]
    return compared


def open_strip(
    path: Path, folders: Sequence[RunFolder], jobs: int = 1, without: Sequence[str] = ()
) -> StripSubject:
    """Strip in the file at `path` with its measured runs in `folders`, ready for a fit
    that does not try the effects named in `without`.

    Raises ConfigurationError for a broken file or run, or an effect that the library
    lacks.
    """
    origin = Origin.before_reading(path, "--strip")
    strip = load_strip(path)
    runs = read_runs(folders, strip)
    return StripSubject(strip, runs, jobs, without, origin=origin)


Index = NDArray[np.int64]
DRAWN_STRIDE = 10  # rows of a run between drawn places of the gripper
CONTACT_SIGNAL, DISTANCE_SIGNAL = (
    "contact [mm]",
    "distance from the measured midline, rms [mm]",
)


def _measured_scene(run: MeasuredRun) -> Scene:
    """Drawing of a measured fold, up to the touch of its layers or to its last row."""
    images = run.images
    rows = run.t
    end = run.end
    t = rows[rows <= end][::DRAWN_STRIDE]
    grip = interpolate_columns(t, rows, run.poses[:, :2])
    visible = _images_before_end(run)
    before_end = run.contact_t <= end
    contact_t = run.contact_t[before_end]
    contact = run.contact_x[before_end]
    points = tuple(images.points[images.image == k] for k in visible)
    return Scene(
        signals=(TimeSeries(CONTACT_SIGNAL, contact_t, 1e3 * contact),),
        curve=Curve(images.stamps[visible], points),
        tracks={"contact": _desk_track(contact_t, contact), "gripper": Track(t, grip)},
        events=_touch_event(run.touch),
    )


def _simulated_scene(
    fold: PreparedFold, model: StripModel, motion: SimulatedMotion
) -> Scene:
    """Drawing of `fold` as it is simulated with `model` in the given `motion`, with
    distances of the measured points from it.

    Distances are of the images that are compared: not those of the first lift and of
    the snap.
    """
    run = fold.run
    observation = model.observation
    contact_t = run.contact_t[run.contact_t <= run.end]
    stamps = run.images.stamps
    seen = imaged_time(observation, contact_t)
    true = np.interp(seen, motion.t, motion.contact_x)
    contact = measured_contact(observation, true)
    images = _images_before_end(run)
    places = fold.residuals.shape_index(model, motion)[images]
    shapes = interpolate_midlines(motion.shapes, places)
    compared, distance = _distances(fold, model, motion)
    return Scene(
        signals=(
            TimeSeries(CONTACT_SIGNAL, contact_t, 1e3 * contact),
            TimeSeries(DISTANCE_SIGNAL, stamps[compared], 1e3 * distance),
        ),
        curve=Curve(stamps[images], tuple(measured_points(model, shapes))),
        tracks={"contact": _desk_track(contact_t, contact)},
        events=_touch_event(simulated_touch(run, model, motion)),
    )


def _images_before_end(run: MeasuredRun) -> Index:
    """Indices of those images of `run` that were taken before its comparison ends."""
    return np.flatnonzero(run.images.stamps <= run.end)


def _distances(
    fold: PreparedFold, model: StripModel, motion: SimulatedMotion
) -> tuple[Index, Array]:
    """Indices of the compared images, and for each the root mean square distance [m] of
    its points from the simulated midline.
    """
    order = np.sort(fold.residuals.layout.profile.order)
    distances = fold.residuals.distances(model, motion, order)
    compared, image = np.unique(fold.run.images.image[order], return_inverse=True)
    return compared, np.sqrt(np.bincount(image, distances**2) / np.bincount(image))


def _desk_track(t: Array, x: Array) -> Track:
    """Track of a point that moves along the desk, at coordinates `x` [m] at the times
    `t` [s].
    """
    return Track(t, np.stack([x, np.zeros_like(x)], axis=1))


def _touch_event(touch: Touch | None) -> tuple[tuple[float, str], ...]:
    """Pair of the time [s] of a `touch` of the layers and a text with its displacement,
    in a tuple; empty where `touch` is None.
    """
    if not touch:
        return ()
    return (
        (touch.time, f"layer_touch, displacement {1e3 * touch.displacement:.1f} mm"),
    )
