"""Cause: a yarn of the strip that is caught on the desk."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from cell.exam.causes.cause import Cause, Sizes
from drivers.twin.chain.extra_forces import ForceFunction, Parts


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

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:  # noqa: ARG002
        """The pull on one link."""
        if self.strength == 0:
            return None
        lumps, joints = parts.lumps, parts.joints
        along = np.cumsum(lumps.spans)
        link = int(np.searchsorted(along, self.position * along[-1]))
        foot, whole = np.array([self.position * along[-1], 0.0]), True

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, ___: float) -> None:
            nonlocal whole
            nodes = joints.nodes(data.qpos)
            there = foot - 0.5 * (nodes[link] + nodes[link + 1])
            distance = float(np.hypot(*there))
            pull = self.stiffness * max(distance - self.length, 0.0)
            whole = whole and pull < self.strength
            if whole and pull > 0.0:
                data.xfrc_applied[1 + link, :3:2] += pull * lumps.scale * there / distance

        return act


CAUSE = CaughtThread
