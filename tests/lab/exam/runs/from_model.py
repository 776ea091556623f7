"""Runs of the state-based tier, simulated by the rod or by a fine chain with hidden causes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cell.config.places import find_configs
from cell.gap.subject.strip.synthetic import Fold, Instruments, reported_path, rod_folds, write_fold
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.motions import GripperPath
from policies.experiments.standard import STANDARD
from policies.registry import MOTION
from tests.lab.exam.case import Case
from tests.lab.exam.causes import cause_of
from tests.lab.exam.runs.by_hand import paths_by_hand
from tests.lab.exam.runs.scatter import RunScatter
from tests.lab.exam.runs.specimen import Specimen

MOTIONS = ("normal", "taut-lift", "fast", "early-shake", "taut-lift", "normal")
BY = Instruments()
SEGMENTS, ROD_STEP = 240, 0.002  # s; finer than any grid of the model
LINKS, CHAIN_STEP, SHAPE_STRIDE = 200, 0.003, 2  # s; every second shape is kept
TARE_STREAM = 78  # of the case's generators, of what tares left


class CaseMotion(NamedTuple):
    """One motion of a case: `name` and `condition` of its run, and the gripper's `path`."""

    name: str
    condition: str
    path: GripperPath


def plant_of(case: Case) -> StripFile:
    """True strip of a case with its scaled base parameters, without hidden effects."""
    return scale_strip(find_configs(None).strip(case.strip), case.stiffness, case.damping)


def scale_strip(strip: StripFile, stiffness: float, damping: float) -> StripFile:
    """Multiply the strip's bending length by `stiffness` and its retardation time by `damping`."""
    length, time = stiffness * strip.bending_length, damping * strip.retardation_time
    return strip.model_copy(update={"bending_length": length, "retardation_time": time})


def make_runs(case: Case, folder: Path) -> None:
    """Simulate the runs of `case` and write a folder for each, with four files that a fit reads."""
    rng = np.random.default_rng([case.seed, 1])
    plant = plant_of(case)
    motions = motions_of(case, plant.length)
    bare = [describe(plant, case.effects, index) for index in range(len(motions))]
    models = [
        after_tare(RunScatter.draw(case.scatter, case.seed, i).in_rig(model), case, i)
        for i, model in enumerate(bare)
    ]
    paths = [motion.path for motion in motions]
    if case.engine == "chain":
        folds = _fold_on_chain(case, models, paths)
    else:
        folds = rod_folds(models, paths, SEGMENTS, ROD_STEP)
    by = replace(BY, force=case.force)
    for index, (motion, bare_fold) in enumerate(zip(motions, folds, strict=True)):
        fold = replace(bare_fold, index=index, condition=motion.condition)
        write_fold(folder / f"{index:02d}-{motion.name}", case.strip, fold, by, rng)


def after_tare(model: StripModel, case: Case, index: int) -> StripModel:
    """Strip model of run `index` with the force offset that the arm's tare left."""
    if case.force is None:
        return model
    rng = np.random.default_rng([case.seed, index, TARE_STREAM])
    x, z = rng.normal(0.0, case.force, 2).tolist()
    return replace(model, observation=replace(model.observation, force_x=x, force_z=z))


def motions_of(case: Case, length: float) -> list[CaseMotion]:
    """Gripper motions of `case` over a strip of `length` [m], in the order of its runs."""
    names = MOTIONS * case.repeats
    if case.motions == "standard":
        return [_standard_motion(name, length) for name in names]
    paths = paths_by_hand(length, case.seed, len(names))
    return [CaseMotion("by-hand", f"by-hand-{i}", path) for i, path in enumerate(paths, start=1)]


def _standard_motion(name: str, length: float) -> CaseMotion:
    """Standard motion `name` over a strip of `length` [m]."""
    return CaseMotion(name, MOTION + name, reported_path(STANDARD[name].of(length)))


def _fold_on_chain(
    case: Case, models: Sequence[StripModel], paths: Sequence[GripperPath]
) -> list[Fold]:
    """Simulate the folds of `case` in a fine chain under its hidden causes."""
    hidden = [cause_of(name, values) for name, values in case.causes.items()]
    specimen = Specimen(LINKS, hidden, case.seed)
    folds = []
    for model, path in zip(models, paths, strict=True):
        motion = simulate(specimen, model, path.t, path.poses, dt=CHAIN_STEP, shapes=True)
        thinned = replace(motion, shapes=motion.shapes[SHAPE_STRIDE - 1 :: SHAPE_STRIDE])
        kept = motion.t[SHAPE_STRIDE - 1 :: SHAPE_STRIDE]
        folds.append(Fold(path, model, thinned, kept, specimen.arc()[0]))
    return folds
