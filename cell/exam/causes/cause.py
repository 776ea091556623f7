"""Base class of hidden causes: their settings, and the points at which they act."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from drivers.settings import Settings
from drivers.strip.model import StripModel
from drivers.twin.chain.extra_forces import ForceFunction, Parts
from drivers.types import Array

Sizes = Mapping[str, Mapping[str, float]]


class Cause(Settings):
    """A property of an exam plant that no description of a strip can hold.

    `amount` names the setting that says how much of it there is. `answers` names the effect of
    the library that it resembles, whose own amount then has the same name and meaning; None where
    there is none, and the right verdict is to abstain. `sizes` are values by strength that leave
    a gap of about 2.5 (medium) and 6 (strong) on denim, for causes that the exam draws. Values
    are SI; at its null a cause changes nothing. All chance comes from the generators that it is
    given.
    """

    amount: ClassVar[str]
    answers: ClassVar[str | None] = None
    sizes: ClassVar[Sizes] = {}

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:  # noqa: ARG002
        """The strip as altered by the cause in the run `model.index`; `rng` is the run's."""
        return model

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:  # noqa: ARG002
        """The forces of the cause on one chain; None where it exerts none."""
        return None

    def true_pose(self, pose: Array, time: float) -> Array:  # noqa: ARG002
        """True pose of the strip's edge at `time` [s] since the grasp, held at `pose` (3,)."""
        return pose

    def image_time(self, since: float) -> float:
        """Age of the world [s] shown in an image stamped `since` [s] after the grasp."""
        return since

    def distortion(self, distortion: tuple[float, float]) -> tuple[float, float]:
        """Radial distortion k1, k2 of the lens, given the calibrated one."""
        return distortion
