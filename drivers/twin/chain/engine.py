"""The chain engine: MuJoCo steps strips as planar chains of hinges; the twin's plant."""

from collections.abc import Sequence

import numpy as np

from drivers.strip.engine import Observables
from drivers.strip.model import StripModel
from drivers.strip.shape import desk_contact, fold_tip
from drivers.twin.chain.contact import LONGEST_STEP
from drivers.twin.chain.extra_forces import ExtraForce
from drivers.twin.chain.strip import ChainStrip
from drivers.types import Array

FEWEST_LINKS = 8


class Chain:
    """Strip engine (`Stepper`): MuJoCo chains of `links` links, stepped one after the other.

    Steps longer than 5 ms are divided into equal parts along the straight line between poses. After
    layer_touch the run goes on: the layers rest on each other. A grip is compliant (10 N pull it by
    7 um on the paper's strip), so a pose that the strip cannot reach costs force, not a fault.
    `foreign` forces act on the strips in addition to those of their models.
    """

    def __init__(self, links: int = 60, foreign: Sequence[ExtraForce] = ()) -> None:
        if links < FEWEST_LINKS:
            raise ValueError(f"links is {links}, allowed: {FEWEST_LINKS} and more")
        self._links, self._foreign = links, tuple(foreign)
        self._strips: list[ChainStrip] = []
        self._models: tuple[StripModel, ...] = ()
        self._time = 0.0

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the strips flat and at rest, gripped at (stated length, 0) with pitch 0, at time 0.

        Raises Unsupported for what a chain cannot represent.
        """
        self._models = tuple(models)
        self._strips = [ChainStrip(model, self._links, self._foreign) for model in models]
        self._time = 0.0

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3) of x, z, pitch at the step's end.

        Raises SimulationNotFinite when a shape leaves the finite numbers.
        """
        targets = np.asarray(poses, dtype=np.float64)
        if targets.shape != (len(self._strips), 3):
            raise ValueError(f"poses are {targets.shape}, expected ({len(self._strips)}, 3)")
        parts = max(1, int(np.ceil(dt / LONGEST_STEP - 1e-6)))
        for strip, pose in zip(self._strips, targets, strict=True):
            strip.advance(pose, dt, parts)
        self._time += dt
        return self._observe()

    def release(self) -> None:
        """Release the strips: later gripper poses have no effect."""
        for strip in self._strips:
            strip.release()

    def shapes(self) -> Array:
        """Midlines (n, links + 1, 2) [m] from the fixed to the grasped edge."""
        return np.stack([strip.points for strip in self._strips])

    def arc(self) -> Array:
        """Arc lengths of the nodes (n, links + 1) [m] from the fixed edge."""
        return np.stack([strip.arc for strip in self._strips])

    def _observe(self) -> Observables:
        heights = [model.observation.contact_height for model in self._models]
        pairs = list(zip(self._strips, heights, strict=True))
        return Observables(
            time=self._time,
            contact_x=np.array([desk_contact(strip.points, height) for strip, height in pairs]),
            tip=np.array([fold_tip(strip.points) for strip in self._strips]),
            holding_force=np.array([strip.holding_force() for strip in self._strips]),
            grip_force=np.array([strip.grip_force() for strip in self._strips]),
            touch=tuple(strip.touch for strip in self._strips),
        )
