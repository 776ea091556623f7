"""Protocol of policies: from an observation to a command of the gripper, for n
strips.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.path import Path


@dataclass(frozen=True, slots=True)
class Observation:
    """Observation of n strips, the input of a policy; arrays (n,) unless stated, [m]
    and [s].

    `x`, `z` are the gripper's, measured now; `contact_x` is the desk contact and
    `tip_x`, `tip_z` the fold's rightmost point at `stamp`, the time of the newest
    image; `time` is now. NaN marks what was not seen. `profile` (n, m, 2) is the
    midline from the desk contact to the gripper at `stamp`, the gripper being its last
    point, and `profile_confidence` (n,) from 0 to 1 its reliability; both are empty
    where profiles are not measured.
    """

    time: Array
    x: Array
    z: Array
    stamp: Array
    contact_x: Array
    tip_x: Array
    tip_z: Array
    profile: Array = field(default_factory=lambda: np.empty((0, 0, 2)))
    profile_confidence: Array = field(default_factory=lambda: np.empty(0))


class Decision(NamedTuple):
    """Command for n grippers, the output of a policy; arrays (n,).

    `direction` phi from the x-axis [rad], `speed` [m/s], and `done` where the policy
    has finished.
    """

    direction: Array
    speed: Array
    done: NDArray[np.bool_]


class Policy(Protocol):
    """Protocol of a folding policy, which converts observations to commands of the
    gripper.
    """

    name: str

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Clear all state; prepare for `count` strips as long as `strip`, at `speed`
        [m/s].
        """

    def lift(self) -> Path:
        """Path whose first section lifts the edge from (L, 0) to the take-over
        height.
        """

    def decide(self, observation: Observation) -> Decision:
        """Command for the gripper of each strip, from the newest `observation`."""
