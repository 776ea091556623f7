"""What every hidden cause is: settings of its own, and the places where it can take hold."""

from typing import ClassVar

import numpy as np

from drivers.settings import Settings
from drivers.strip.model import StripModel
from drivers.twin.chain.extra_forces import ForceFunction, Parts
from drivers.types import Array


class Cause(Settings):
    """Something that a plant of the exam has and no description of a strip holds.

    `answers` names the effect of the library that it resembles; None where there is none, and the
    right verdict is to abstain. Values are SI; at its null a cause changes nothing. All chance
    comes from the generators that it is given.
    """

    answers: ClassVar[str | None] = None

    def described(self, model: StripModel, rng: np.random.Generator) -> StripModel:  # noqa: ARG002
        """The strip as it lies there in the run `model.index`; `rng` is the run's."""
        return model

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:  # noqa: ARG002
        """The forces of the cause on one chain; None where it exerts none."""
        return None

    def moved(self, pose: Array, time: float) -> Array:  # noqa: ARG002
        """Where the strip's edge truly is at `time` [s] since the grasp, held at `pose` (3,)."""
        return pose

    def shown(self, since: float) -> float:
        """How old the world is that an image shows, stamped `since` [s] after the grasp [s]."""
        return since

    def distorted(self, distortion: tuple[float, float]) -> tuple[float, float]:
        """Radial k1, k2 of the lens, from those with which it was calibrated."""
        return distortion
