"""The strip as a subject of the gap workflow."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from itertools import groupby, islice
from pathlib import Path
from typing import cast

import numpy as np

from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.scene import Scene
from cell.gap.subject.strip.compare import Comparison
from cell.gap.subject.strip.experiments import instruction, minutes, next_index, planned_runs
from cell.gap.subject.strip.layout import Floors
from cell.gap.subject.strip.patch import patch_file
from cell.gap.subject.strip.prepare import Fold, correct, prepare, surroundings
from cell.gap.subject.strip.replicates import replicates
from cell.gap.subject.strip.runs import MeasuredRun, read_runs
from cell.gap.subject.strip.scatter import FORCE_EFFECTS, RUN_EFFECTS, RunEffect
from cell.gap.subject.strip.scenes import measured_scene, simulated_scene
from cell.gap.subject.strip.scope import file_values, scope
from cell.gap.subject.strip.simulation import (
    COARSE,
    ROUGH,
    SELDOM,
    HashedModel,
    Job,
    SimulatedMotion,
    Simulation,
)
from cell.gap.subject.subject import Experiment, Parameter, Request, Residuals, Run, Scope
from drivers.errors import ConfigurationError
from drivers.strip.describe import describe, load_strip
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.strip.law import with_law
from drivers.strip.model import Observation

QUANTILE = 0.02
DESCRIBED = 256  # descriptions that are kept
PORTION = 64  # motions that are held at once
AGEING = frozenset({"ageing", "term_run"})
"""Effects and terms that depend on the number of the run: all others share one description."""
Values = tuple[float, ...]
Look = tuple[str, bytes, bool, Observation]  # run, motion, whether rough, how it is looked at


class Strip:
    """Measured folds of one strip, simulated by the rod along the measured gripper paths.

    `notes` warn the operator of runs that are not whole.
    """

    def __init__(
        self,
        strip: StripFile,
        runs: Sequence[MeasuredRun],
        jobs: int = 1,
        floors: Floors | None = None,
        without: Sequence[str] = (),
        scatter: Sequence[RunEffect] = RUN_EFFECTS,
    ) -> None:
        self.file = strip
        self.notes = tuple(note for run in runs for note in run.notes)
        self._measured = tuple(run for run in runs if run.usable)
        self._floors = floors or Floors()
        has_force = any(run.measured.has_force for run in self._measured)
        scatter = (*scatter, *FORCE_EFFECTS) if has_force else scatter
        lifted = _lift_off_position(self._measured)
        self._scope = scope(strip, self._floors, lifted, without, has_force=has_force)
        self._ages = not AGEING.isdisjoint({*strip.effects, *strip.law})
        self._jobs, self._scatter = jobs, tuple(scatter)
        self._simulation = Simulation(COARSE, jobs)
        self._rough = Simulation(ROUGH, jobs, SELDOM)
        self._known: dict[Look, tuple[Comparison, Residuals]] = {}
        self._described = lru_cache(DESCRIBED)(partial(_describe, strip, self._scope.base))
        self._runs = prepare(self._measured, strip, self._floors, self._simulation, jobs, scatter)
        self._replicates = replicates(self._runs)

    @property
    def name(self) -> str:
        """The strip's name."""
        return self.file.name

    @property
    def runs(self) -> Sequence[Run]:
        """The measured folds, in the order in which they were taken."""
        return self._runs

    @property
    def scope(self) -> Scope:
        """Base parameters, candidates, quantities and terms of the strip."""
        return self._scope

    def simulate(self, requests: Sequence[Request]) -> list[Residuals]:
        """Residuals, measured minus simulated; each motion is simulated once."""
        folds, drives = self._drive(requests)
        looks = [
            (request.run.name, drive.key, request.rough, drive.model.observation)
            for request, drive in zip(requests, drives, strict=True)
        ]
        seen = self._compare(dict(zip(looks, zip(folds, drives, strict=True), strict=True)))
        return [
            fold.correct(seen[look], request.run, request.local)
            for request, fold, look in zip(requests, folds, looks, strict=True)
        ]

    def _compare(self, asked: Mapping[Look, tuple[Fold, Job]]) -> dict[Look, Residuals]:
        """Residuals of each motion against its run, a portion at a time: motions are large and not
        kept; residuals are small and cached.

        Motions of one length together, in the order in which they are asked, as they are simulated.
        """
        found = {}
        for look, (fold, _) in asked.items():
            comparison, residuals = self._known.get(look, (None, None))
            if residuals is not None and comparison is fold.comparison:
                found[look] = residuals
        new = {look: each for look, each in asked.items() if look not in found}
        compared = self._compare_new(new)
        self._known |= {look: (new[look][0].comparison, r) for look, r in compared.items()}
        return found | compared

    def _compare_new(self, asked: Mapping[Look, tuple[Fold, Job]]) -> dict[Look, Residuals]:
        first = {look[1]: i for i, look in reversed(list(enumerate(asked)))}
        order = sorted(asked, key=lambda k: (k[2], asked[k][1].way.duration, first[k[1]]))
        seen: dict[Look, Residuals] = {}
        with ThreadPoolExecutor(self._jobs) as pool:
            for rough, group in groupby(order, key=lambda look: look[2]):
                simulated, looks = self._rough if rough else self._simulation, iter(group)
                while portion := list(islice(looks, PORTION)):
                    folds, drives = zip(*(asked[look] for look in portion), strict=True)
                    shown = simulated(drives)
                    found = pool.map(_residuals, folds, drives, shown)
                    seen.update(zip(portion, found, strict=True))
        return seen

    def draw_measured(self, run: Run) -> Scene:
        """Drawing of the measured fold."""
        return measured_scene(cast(Fold, run.content).comparison.run)

    def draw_simulated(self, requests: Sequence[Request]) -> list[Scene | None]:
        """Drawings of the simulated folds, beside their images."""
        folds, drives = self._drive(requests)
        length = self.file.length
        return [
            None if motion is None else simulated_scene(fold, drive.model, motion, length)
            for fold, drive, motion in zip(folds, drives, self._simulation(drives), strict=True)
        ]

    def refine(self, requests: Sequence[Request]) -> Sequence[Run]:
        """The runs with corrections from a finer rod at these values, and slopes there."""
        folds, drives = self._drive(requests)
        about = surroundings(folds, drives, self._simulation, self._jobs, self._scatter)
        return [
            correct(request.run, fold, here)
            for request, fold, here in zip(requests, folds, about, strict=True)
        ]

    def experiments(self) -> Sequence[Experiment]:
        """The standard folds as planned runs, simulated for the stated strip."""
        runs = planned_runs(self.file, self._measured[0].measured.sigma, next_index(self._measured))
        ready = prepare(runs, self.file, self._floors, self._simulation, self._jobs)
        asked = {run.name: run for run in runs}
        return [
            Experiment(r.name, instruction(asked[r.name]), minutes(asked[r.name]), r) for r in ready
        ]

    def patch(
        self, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]], source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """The strip file with refitted base, named effects or laws, and the cell's effects."""
        return patch_file(self.file, base, effects, source)

    def _drive(self, requests: Sequence[Request]) -> tuple[list[Fold], list[Job]]:
        folds = [cast(Fold, request.run.content) for request in requests]
        drives = [
            self._simulated_fold(r, f).drive(self._model(r, f))
            for r, f in zip(requests, folds, strict=True)
        ]
        return folds, drives

    def _simulated_fold(self, request: Request, fold: Fold) -> Fold:
        """The fold whose path is simulated: approximately, the first of its replicates."""
        return self._replicates.get(fold.way.digest, fold) if request.rough else fold

    def _model(self, request: Request, fold: Fold) -> HashedModel:
        effects = tuple((name, tuple(map(float, v))) for name, v in request.effects.items())
        ages = self._ages or not AGEING.isdisjoint(request.effects)
        index = fold.index if ages else 0
        return self._described(tuple(map(float, request.base)), effects, index)


def _describe(
    strip: StripFile,
    parameters: Sequence[Parameter],
    base: Values,
    effects: tuple[tuple[str, Values], ...],
    index: int,
) -> HashedModel:
    """The strip with these values of its base `parameters` and these effects of the library."""
    numbers: dict[str, float] = {}
    kept = {name: dict(values) for name, values in strip.effects.items()}
    for p, value in zip(parameters, base, strict=True):
        if "." in p.name:
            effect, key = p.name.split(".")
            kept[effect][key] = p.stated_value(value)
        else:
            numbers[p.name] = value
    strip = strip.model_copy(update={**numbers, "effects": kept})
    known = [(registry()[name], values) for name, values in effects if name in registry()]
    added = {e.name: file_values(e, values) for e, values in known}
    model = describe(strip, {k: v for k, v in added.items() if v is not None}, index)
    return HashedModel.of(with_law(model, {name: values[0] for name, values in effects}))


def _residuals(fold: Fold, drive: Job, shown: SimulatedMotion | None) -> Residuals:
    """Residuals of a simulated motion against the run of `fold`."""
    return fold.comparison(drive.model, shown)


def _lift_off_position(runs: Sequence[MeasuredRun]) -> float:
    """Arc length [m] from which on the strip leaves the desk; 0 where no image shows it."""
    seen = [run.measured.contact_x for run in runs if len(run.measured.contact_x)]
    return min((float(np.quantile(x, QUANTILE)) for x in seen), default=0.0)


def open_strip(
    path: Path, folders: Sequence[RunFolder], jobs: int = 1, without: Sequence[str] = ()
) -> Strip:
    """The strip of a file with its measured runs, checked; effects `without` are no candidates.

    Raises ConfigurationError for a broken file or run, or an effect that the library lacks.
    """
    strip = load_strip(path)
    for name in without:
        if name not in registry():
            known = ", ".join(sorted(registry()))
            raise ConfigurationError(f"--without {name}: is no effect; allowed: {known}")
    if registry().keys() <= {*without, *strip.effects}:
        raise ConfigurationError("--without: withholds every effect; leave one to look for")
    return Strip(strip, read_runs(folders, strip), jobs, without=without)
