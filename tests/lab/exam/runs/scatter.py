"""Run-to-run scatter as in a laboratory: grip, damping and stiffness drawn for each run."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from drivers.strip.model import StripModel
from drivers.types import Array, frozen
from tests.lab.exam.case import Scattered

GRASP = 0.3  # s after the grasp, in which the edge moves to where it is truly held
SCATTER_STREAM = 77  # of the case's generators, of this one


@dataclass(frozen=True, slots=True)
class Scatter:
    """Run-to-run standard deviations: grip in x and in z [m], damping and stiffness (shares).

    Source: grasping flat cloth by two fingers repeats to 0.1 to 0.5 mm; internal damping of
    fabric follows humidity and rest by a few per cent, its stiffness by a tenth of that.
    """

    grip: float
    damping: float
    stiffness: float


LEVELS: dict[Scattered, Scatter] = {
    "none": Scatter(0.0, 0.0, 0.0),
    "half": Scatter(0.00015, 0.025, 0.0025),
    "full": Scatter(0.0003, 0.05, 0.005),
}


@dataclass(frozen=True, slots=True)
class RunScatter:
    """Scatter of one run: true minus reported grip (2,) [m], factors on damping and stiffness."""

    grip: Array
    damping: float
    stiffness: float

    @classmethod
    def draw(cls, level: Scattered, seed: int, index: int) -> Self:
        """Draw the scatter of run `index` of a case with `seed`; exactly zero at level `none`."""
        sigma, rng = LEVELS[level], np.random.default_rng([seed, index, SCATTER_STREAM])
        grip = frozen(sigma.grip * rng.standard_normal(2))
        damping, stiffness = rng.standard_normal(2)
        return cls(grip, 1.0 + sigma.damping * damping, 1.0 + sigma.stiffness * stiffness)

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
        """Strip model with the damping, the stiffness and, in its rig, the grip of this run."""
        if not self.grip.any():
            return self.alter(model)
        rig, (x, z) = model.rig, self.grip.tolist()
        rig = replace(rig, grip_x=rig.grip_x + x, grip_z=rig.grip_z + z)
        return replace(self.alter(model), rig=rig)

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose` (3,)."""
        share = min(time / GRASP, 1.0)
        return np.asarray(pose + share * np.array([*self.grip, 0.0]))
