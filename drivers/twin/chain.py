"""The chain engine: MuJoCo steps strips as planar chains of hinges. It plays the plant."""

from collections.abc import Sequence

import numpy as np

from drivers.strip.engine import Observables
from drivers.strip.model import StripModel
from drivers.strip.shape import Touch
from drivers.twin.chain_spec import STEP
from drivers.twin.chain_strip import ChainStrip
from drivers.types import Array


class Chain:
    """A Stepper over MuJoCo chains of `links` links, one after the other.

    Steps longer than 5 ms are taken in equal parts along the straight line between poses.
    After layer_touch the run goes on: the layers rest on each other.
    """

    def __init__(self, links: int = 60) -> None:
        if links < 8:
            raise ValueError(f"a chain needs at least 8 links, found {links}")
        self._links = links
        self._strips: list[ChainStrip] = []
        self._time = 0.0

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the strips flat and still, grippers at (L, 0), pitch 0, time 0.

        Raises Unsupported for a strip that is not as long as stated.
        """
        self._strips = [ChainStrip(model, self._links) for model in models]
        self._time = 0.0

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3) of x, z, pitch at the step's end.

        Raises SimulationNotFinite when a shape leaves the finite numbers.
        """
        if np.shape(poses) != (len(self._strips), 3):
            raise ValueError(f"poses are {np.shape(poses)}, expected ({len(self._strips)}, 3)")
        parts = max(1, int(np.ceil(dt / STEP - 1e-6)))
        for strip, pose in zip(self._strips, poses, strict=True):
            strip.advance(pose, dt, parts)
        self._time += dt
        seen = [strip.observe() for strip in self._strips]
        return Observables(
            time=self._time,
            contact_x=np.array([s.contact_x for s in seen]),
            tip=np.array([s.tip for s in seen]),
            holding_force=np.array([s.holding_force for s in seen]),
            touch=tuple(s.touch for s in seen),
        )

    def release(self) -> None:
        """Let go of the strips: from now on the gripper poses move nothing."""
        for strip in self._strips:
            strip.release()

    def shapes(self) -> Array:
        """Midlines (n, links + 1, 2) [m] from the fixed to the grasped edge."""
        return np.stack([strip.points for strip in self._strips])

    def arc(self) -> Array:
        """Arc lengths of the nodes (n, links + 1) [m] from the fixed edge."""
        return np.stack([strip.arc for strip in self._strips])

    @property
    def touches(self) -> tuple[Touch | None, ...]:
        """layer_touch of each strip so far."""
        return tuple(strip.touch for strip in self._strips)
