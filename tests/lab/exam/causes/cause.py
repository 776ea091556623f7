"""Base class of hidden causes: their settings, and the points at which they act."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from drivers.base.settings import Settings
from drivers.base.types import Array
from drivers.strip.model import StripModel
from drivers.twin.chain.forces import ForceFunction, Parts

Sizes = Mapping[str, Mapping[str, float]]
# of the chain's bodies: all but the world, the tip and the gripper
LINK_ROWS = slice(1, -2)
# columns of MuJoCo's applied force; moments follow
FORCE_XZ, FORCE_Z = slice(0, 3, 2), 2


class Cause(Settings):
    """Base class of hidden causes: properties of an exam plant that no strip file can
    describe.

    `amount` names the setting of its size. `answers` names the effect of the library
    that it resembles, whose own amount then has the same name and meaning; None where
    there is none, and the right verdict is to abstain. `sizes` are values by strength
    that leave a gap of about 2.5 (medium) and 6 (strong) on denim, for causes that the
    exam draws. Values are SI; of the amount `null` there is no cause. All chance comes
    from the generators that it is given.
    """

    amount: ClassVar[str]
    null: ClassVar[float] = 0.0
    answers: ClassVar[str | None] = None
    sizes: ClassVar[Sizes] = {}

    @property
    def acts(self) -> bool:
        """Whether the cause changes anything."""
        return bool(getattr(self, self.amount) != self.null)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model as altered by the cause in run `model.index`; `rng` is the run's
        own.
        """
        return model

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Force function of the cause for one chain; None where it exerts no force."""
        return None

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose`
        (3,).
        """
        return pose

    def image_time(self, since: float) -> float:
        """True time [s] after the grasp that an image stamped `since` [s] after the
        grasp shows.
        """
        return since
