"""Runs of the state-based tier: standard motions in the rod or a fine chain, noise added."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cell.config.places import find_configs
from cell.exam.case import Case
from cell.exam.runs.scatter import RunScatter
from cell.gap.subject.strip.synthetic import Fold, Instruments, rod_folds, write_fold
from cell.gap.subject.strip.ways import way_of
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.motions import GripperPath
from drivers.twin.chain.engine import Chain
from policies.registry import MOTION
from policies.standard import STANDARD

MOTIONS = ("normal", "fast", "early-shake", "taut-lift", "normal")
BY = Instruments()
SEGMENTS, ROD_STEP = 240, 0.002  # finer than either grain of the model
LINKS, CHAIN_STEP, SHOWN = 200, 0.003, 2  # of which every second shape is kept


def plant_of(case: Case) -> StripFile:
    """The strip that really lies on the desk, its hidden effects aside."""
    strip = find_configs(None).strip(case.strip)
    return strip.model_copy(
        update={
            "bending_length": case.stiffness * strip.bending_length,
            "retardation_time": case.damping * strip.retardation_time,
        }
    )


def make_runs(case: Case, folder: Path) -> None:
    """The case's run folders in `folder`, each of the four files that a fit reads."""
    rng = np.random.default_rng([case.seed, 1])
    plant = plant_of(case)
    motions = MOTIONS * case.repeats
    bare = [describe(plant, case.effects, index) for index in range(len(motions))]
    models = [
        RunScatter.drawn(case.scatter, case.seed, i).held(model) for i, model in enumerate(bare)
    ]
    ways = [way_of(STANDARD[name].of(plant.length)) for name in motions]
    folds = _chained(models, ways) if case.engine == "chain" else _rod(models, ways)
    for index, (name, fold) in enumerate(zip(motions, folds, strict=True)):
        write_fold(folder / f"{index:02d}-{name}", case.strip, fold, BY, rng)


def _rod(models: Sequence[StripModel], ways: Sequence[GripperPath]) -> list[Fold]:
    return [_told(f, i) for i, f in enumerate(rod_folds(models, ways, SEGMENTS, ROD_STEP))]


def _chained(models: Sequence[StripModel], ways: Sequence[GripperPath]) -> list[Fold]:
    chain = Chain(LINKS)
    folds = []
    for index, (model, way) in enumerate(zip(models, ways, strict=True)):
        motion = simulate(chain, model, way.t, way.poses, dt=CHAIN_STEP, shapes=True)
        thinned = replace(motion, shapes=motion.shapes[SHOWN - 1 :: SHOWN])
        kept = motion.t[SHOWN - 1 :: SHOWN]
        folds.append(_told(Fold(way, model, thinned, kept, chain.arc()[0]), index))
    return folds


def _told(fold: Fold, index: int) -> Fold:
    """The fold with its place in the order and its condition."""
    return replace(fold, index=index, condition=MOTION + MOTIONS[index % len(MOTIONS)])
