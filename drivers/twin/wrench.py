"""The strip's force on the gripper as an arm reports it: late, noisy, with what its tare left."""

from math import exp

import numpy as np

from drivers.motion import TICK
from drivers.twin.settings import WrenchSettings


class ExternalWrench:
    """The external force of the twin's arm, in the plane of the strip.

    An arm estimates it from the torques of its motors, averaged over some time; what its tare did
    not take off stays for the session.
    """

    def __init__(self, settings: WrenchSettings, rng: np.random.Generator) -> None:
        """An arm that feels nothing yet; noise and offset come from `rng`."""
        self._rng = rng
        self._noise = settings.noise
        self._share = 1.0 if settings.lag == 0 else 1.0 - exp(-TICK / settings.lag)
        self._offset = settings.bias * rng.standard_normal(2)
        self._average = np.zeros(2)
        self._reading = (0.0, 0.0)

    def tick(self, force: tuple[float, float]) -> None:
        """Measure the true `force` (f_x, f_z) [N] of this tick."""
        self._average += self._share * (np.array(force) - self._average)
        noise = self._noise * self._rng.standard_normal(2)
        x, z = (self._average + self._offset + noise).tolist()
        self._reading = (x, z)

    @property
    def reading(self) -> tuple[float, float]:
        """What the arm reports, (f_x, f_z) [N]."""
        return self._reading
