"""Runs of a case from the state: the plant as rod or chain, how runs differ, motions by
hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from cell.base.config.places import find_configs
from cell.gap.subject.strip.synthetic import (
    BENCH,
    ROW_STRIDE,
    Fold,
    reported_path,
    rod_folds,
    write_fold,
)
from drivers.base.geometry import arc_lengths
from drivers.base.types import Array, frozen
from drivers.strip.describe import describe
from drivers.strip.engine import Observables
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import GripperPath
from drivers.twin.camera import ScenesOverTime
from drivers.twin.chain.engine import Chain
from drivers.twin.world import WorldState
from policies.experiments.motion import STEP, generator, hand_path, wavering
from policies.experiments.standard import STANDARD
from policies.path import lift_pitch
from policies.registry import MOTION
from tests.lab.exam.case import Case, ScatterLevel
from tests.lab.exam.causes import cause_of
from tests.lab.exam.causes.cause import Cause
from tests.support.effect_cases import simulate

GRASP = 0.3  # s after the grasp, in which the edge moves to where it is truly held
SCATTER_STREAM = 77  # of the case's generators, of this one


@dataclass(frozen=True, slots=True)
class Scatter:
    """Run-to-run standard deviations: grip in x and in z [m], damping and stiffness
    (shares).

    Source: grasping flat cloth by two fingers repeats to 0.1 to 0.5 mm; internal
    damping of fabric follows humidity and rest by a few per cent, its stiffness by a
    tenth of that.
    """

    grip: float
    damping: float
    stiffness: float


LEVELS: dict[ScatterLevel, Scatter] = {
    "none": Scatter(0.0, 0.0, 0.0),
    "half": Scatter(0.00015, 0.025, 0.0025),
    "full": Scatter(0.0003, 0.05, 0.005),
}


@dataclass(frozen=True, slots=True)
class RunScatter:
    """Scatter of one run: true minus reported grip (2,) [m], factors on damping and
    stiffness.
    """

    grip: Array
    damping: float
    stiffness: float

    @classmethod
    def draw(cls, level: ScatterLevel, seed: int, index: int) -> Self:
        """Draw the scatter of run `index` of a case with `seed`; exactly zero at level
        `none`.
        """
        sigma, rng = LEVELS[level], np.random.default_rng([seed, index, SCATTER_STREAM])
        grip = frozen(sigma.grip * rng.standard_normal(2))
        damping, stiffness = rng.standard_normal(2)
        return cls(
            grip, 1.0 + sigma.damping * damping, 1.0 + sigma.stiffness * stiffness
        )

    def alter(self, model: StripModel) -> StripModel:
        """Strip model with the damping and stiffness of this run."""
        if self.damping == 1.0 and self.stiffness == 1.0:
            return model
        strip = model.mechanics
        rigidity = frozen(strip.rigidity * self.stiffness)
        viscosity = frozen(strip.viscosity * self.damping)
        mechanics = replace(strip, rigidity=rigidity, viscosity=viscosity)
        return replace(model, mechanics=mechanics)

    def in_rig(self, model: StripModel) -> StripModel:
        """Strip model with the damping, the stiffness and, in its rig, the grip of this
        run.
        """
        if not self.grip.any():
            return self.alter(model)
        rig, (x, z) = model.rig, self.grip.tolist()
        rig = replace(rig, grip_x=rig.grip_x + x, grip_z=rig.grip_z + z)
        return replace(self.alter(model), rig=rig)

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose`
        (3,).
        """
        share = min(time / GRASP, 1.0)
        return np.asarray(pose + share * np.array([*self.grip, 0.0]))


class Specimen:
    """Engine that simulates one strip under `causes`, random by `seed` and the run's
    index.

    Runs differ by `scatter` besides. Without causes and scatter it is a chain of
    `links` links, bit for bit.
    """

    def __init__(
        self,
        links: int,
        causes: Sequence[Cause],
        seed: int,
        scatter: ScatterLevel = "none",
    ) -> None:
        self._links, self._seed = links, seed
        self._causes = tuple(cause for cause in causes if cause.acts)
        self._level: ScatterLevel = scatter
        self._scatter = RunScatter.draw(scatter, seed, 0)
        self._time = 0.0
        self._chain = Chain(links)

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the one strip flat and still, altered by its causes as in run `index`."""
        (model,) = models
        rngs = [
            np.random.default_rng([self._seed, model.index, k])
            for k in range(len(self._causes))
        ]
        self._scatter = RunScatter.draw(self._level, self._seed, model.index)
        model = self._scatter.alter(model)
        for cause, rng in zip(self._causes, rngs, strict=True):
            model = cause.alter(model, rng)
        laws = [
            partial(c.begin, rng=rng) for c, rng in zip(self._causes, rngs, strict=True)
        ]
        self._time = 0.0
        self._chain = Chain(self._links, laws)
        self._chain.reset([model])

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (1, 3), which causes may offset."""
        self._time += dt
        true = np.asarray(poses, dtype=np.float64)
        if self._level != "none":
            true = np.stack(
                [self._scatter.true_pose(pose, self._time) for pose in true]
            )
        for cause in self._causes:
            true = np.stack([cause.true_pose(pose, self._time) for pose in true])
        return self._chain.step(true, dt)

    def release(self) -> None:
        """Release the grasped edge."""
        self._chain.release()

    def shapes(self) -> Array:
        """Nodes (1, links + 1, 2) [m] of the strip's midline."""
        return self._chain.shapes()

    def arc(self) -> Array:
        """Arc lengths (1, links + 1) [m] of the midline's nodes."""
        return self._chain.arc()


class LaggedView:
    """Scene source for a camera whose image stamps differ, by `causes`, from the true
    time.
    """

    def __init__(self, view: ScenesOverTime, causes: Sequence[Cause]) -> None:
        self._view, self._causes = view, tuple(causes)
        self._grasped: float | None = None

    def __call__(self, stamp: float) -> WorldState:
        """Scene that an image stamped `stamp` [s] shows: the world at the image's true
        time.
        """
        if self._grasped is None:
            seen = self._view(stamp)
            if not seen.holds_strip:
                return seen
            self._grasped = stamp
        since = stamp - self._grasped
        for cause in self._causes:
            since = cause.image_time(since)
        return replace(self._view(self._grasped + since), stamp=stamp)


TREMOR = 0.0002  # m, one sigma in x and in z
SHIVER = (1.0, 5.0)  # Hz


def paths_by_hand(length: float, seed: int, count: int) -> list[GripperPath]:
    """Gripper paths of `count` motions by hand over a strip of `length` [m], set by
    `seed`.
    """
    return [_reported_path(length, generator(seed, i)) for i in range(count)]


def _reported_path(length: float, rng: np.random.Generator) -> GripperPath:
    line, travel = hand_path(length, rng)
    t: Array = STEP * np.arange(len(travel), dtype=float)
    share = travel / line.x[-1]
    # a gripper that grasps or is done stands still
    fading = (4.0 * share * (1.0 - share))[:, None]
    tremor = np.stack([wavering(t, SHIVER, rng) for _ in range(2)], axis=1)
    places = line(travel) + TREMOR * np.clip(fading, 0.0, 1.0) * tremor
    poses = np.column_stack([places, lift_pitch(arc_lengths(places))])
    return GripperPath(frozen(t[::ROW_STRIDE]), frozen(poses[::ROW_STRIDE]))


MOTIONS = ("normal", "taut-lift", "fast", "early-shake", "taut-lift", "normal")
SEGMENTS, ROD_STEP = 240, 0.002  # s; finer than any grid of the model
LINKS, CHAIN_STEP, SHAPE_STRIDE = 200, 0.003, 2  # s; every second shape is kept


class CaseMotion(NamedTuple):
    """One motion of a case: `name` and `condition` of its run, and the gripper's
    `path`.
    """

    name: str
    condition: str
    path: GripperPath


def plant_of(case: Case) -> StripFile:
    """True strip of a case with its scaled base parameters, without hidden effects."""
    return scale_strip(
        find_configs(None).strip(case.strip), case.stiffness, case.damping
    )


def scale_strip(strip: StripFile, stiffness: float, damping: float) -> StripFile:
    """Multiply the strip's bending length by `stiffness` and its retardation time by
    `damping`.
    """
    length, time = stiffness * strip.bending_length, damping * strip.retardation_time
    return strip.model_copy(update={"bending_length": length, "retardation_time": time})


def make_runs(case: Case, folder: Path) -> None:
    """Simulate the runs of `case` and write a folder for each, with four files that a
    fit reads.
    """
    rng = np.random.default_rng([case.seed, 1])
    plant = plant_of(case)
    motions = motions_of(case, plant.length)
    bare = [describe(plant, case.effects, index) for index in range(len(motions))]
    models = [
        RunScatter.draw(case.scatter, case.seed, i).in_rig(model)
        for i, model in enumerate(bare)
    ]
    paths = [motion.path for motion in motions]
    if case.engine == "chain":
        folds = _fold_on_chain(case, models, paths)
    else:
        folds = rod_folds(models, paths, SEGMENTS, ROD_STEP)
    for index, (motion, bare_fold) in enumerate(zip(motions, folds, strict=True)):
        fold = replace(bare_fold, index=index, condition=motion.condition)
        write_fold(folder / f"{index:02d}-{motion.name}", case.strip, fold, BENCH, rng)


def motions_of(case: Case, length: float) -> list[CaseMotion]:
    """Gripper motions of `case` over a strip of `length` [m], in the order of its
    runs.
    """
    if case.motions == "standard":
        return [_standard_motion(name, length) for name in MOTIONS]
    paths = paths_by_hand(length, case.seed, len(MOTIONS))
    return [
        CaseMotion("by-hand", f"by-hand-{i}", path)
        for i, path in enumerate(paths, start=1)
    ]


def _standard_motion(name: str, length: float) -> CaseMotion:
    """Standard motion `name` over a strip of `length` [m]."""
    return CaseMotion(name, MOTION + name, reported_path(STANDARD[name].over(length)))


def _fold_on_chain(
    case: Case, models: Sequence[StripModel], paths: Sequence[GripperPath]
) -> list[Fold]:
    """Simulate the folds of `case` in a fine chain under its hidden causes."""
    hidden = [cause_of(name, values) for name, values in case.causes.items()]
    specimen = Specimen(LINKS, hidden, case.seed)
    folds = []
    for model, path in zip(models, paths, strict=True):
        motion = simulate(
            specimen, model, path.t, path.poses, dt=CHAIN_STEP, shapes=True
        )
        thinned = replace(
            motion, shapes=motion.shapes[SHAPE_STRIDE - 1 :: SHAPE_STRIDE]
        )
        kept = motion.t[SHAPE_STRIDE - 1 :: SHAPE_STRIDE]
        folds.append(Fold(path, model, thinned, kept, specimen.arc()[0]))
    return folds
