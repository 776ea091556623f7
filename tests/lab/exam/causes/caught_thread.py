"""Hidden cause: a yarn of the strip that is caught on the desk."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts
from drivers.types import Array
from tests.lab.exam.causes.cause import FORCE_XZ, Cause, Sizes


class CaughtThread(Cause):
    """Thread from the strip to the desk under it, which tears for good at a pull of `strength` [N].

    It is slack for its `length`, then pulls by `stiffness` times what is drawn out of the weave.
    Source: assumed; drawing one yarn out of a woven strip takes 0.01 to 0.1 N.
    """

    amount: ClassVar[str] = "strength"
    sizes: ClassVar[Sizes] = {"medium": {"strength": 0.012}, "strong": {"strength": 0.022}}

    strength: float = Field(ge=0, le=1)  # N
    position: float = Field(0.7, gt=0.05, lt=0.95)  # share of the strip's length
    length: float = Field(0.03, ge=0, le=0.3)  # m
    stiffness: float = Field(0.5, gt=0, le=5)  # N/m

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Pull of the thread on the link that it is tied to; None without strength."""
        if self.strength == 0:
            return None
        ends = np.cumsum(parts.lumps.spans)
        place = self.position * ends[-1]
        return _Thread(self, parts, int(np.searchsorted(ends, place)), np.array([place, 0.0]))


@dataclass(slots=True)
class _Thread:
    """Force function of a thread from the middle of link `link` to its `foot` (2,) on the desk."""

    cause: CaughtThread
    parts: Parts
    link: int
    foot: Array
    whole: bool = True

    def __call__(self, _: mujoco.MjModel, data: mujoco.MjData, __: float, ___: float) -> None:
        """Pull the link towards the foot, or tear."""
        nodes = self.parts.joints.nodes(data.qpos)
        to_foot = self.foot - 0.5 * (nodes[self.link] + nodes[self.link + 1])
        distance = float(np.hypot(*to_foot))
        pull = self.cause.stiffness * max(distance - self.cause.length, 0.0)
        self.whole = self.whole and pull < self.cause.strength
        if self.whole and pull > 0.0:
            body = 1 + self.link  # after the world
            force = pull * self.parts.lumps.scale * to_foot / distance
            data.xfrc_applied[body, FORCE_XZ] += force


CAUSE = CaughtThread
