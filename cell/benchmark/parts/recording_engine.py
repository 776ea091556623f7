"""Records an engine's observables at each decision of a fold."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.strip.engine import Observables, Stepper
from drivers.strip.model import StripModel
from drivers.types import Array
from policies.path import TAKEOVER_HEIGHT
from policies.rollout import Marching


class RecordingEngine:
    """Engine wrapper that records contacts, holding forces, gripper heights and maybe `shapes`."""

    def __init__(self, engine: Stepper, *, shapes: bool = False) -> None:
        self.midlines: list[Array] = []
        self.contacts: list[Array] = []
        self._engine = engine
        self._with_shapes = shapes
        self._forces: list[Array] = []
        self._heights: list[Array] = []
        self._going: list[NDArray[np.bool_]] = []

    def reset(self, models: Sequence[StripModel]) -> None:
        """Reset the wrapped engine."""
        self._engine.reset(models)

    def step(self, poses: Array, dt: float) -> Observables:
        """Step the wrapped engine and record the step."""
        return self.advance(poses[None], dt)

    def advance(self, poses: Array, dt: float) -> Observables:
        """Advance the wrapped engine and record the last step."""
        if isinstance(self._engine, Marching):
            seen = self._engine.advance(poses, dt)
        else:
            seen = [self._engine.step(pose, dt) for pose in poses][-1]
        self.contacts.append(seen.contact_x.copy())
        self._forces.append(np.abs(seen.holding_force))
        self._heights.append(poses[-1, :, 1].copy())
        self._going.append(np.array([touch is None for touch in seen.touch]))
        if self._with_shapes:
            self.midlines.append(self._engine.shapes().copy())
        return seen

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] of the wrapped engine."""
        return self._engine.shapes()

    def arc(self) -> Array:
        """Arc lengths (n, nodes) [m] of the wrapped engine."""
        return self._engine.arc()

    @property
    def frames(self) -> NDArray[np.int64]:
        """Number of decisions (n,) of each strip up to and including that of its touch."""
        lived = np.sum(self._going, axis=0)
        return np.asarray(np.minimum(lived + 1, len(self._going)), dtype=np.int64)

    @property
    def holding_force(self) -> Array:
        """Mean magnitude of the force (n,) [N] from the take-over to the touch.

        As in the paper; the lift before is not the policy's.
        """
        lifted = np.maximum.accumulate(np.array(self._heights), axis=0) >= TAKEOVER_HEIGHT
        counted = np.array(self._going) & lifted
        total = np.where(counted, np.array(self._forces), 0.0).sum(axis=0)
        return np.asarray(total / np.maximum(counted.sum(axis=0), 1))
