"""Hidden cause: a sticky spot on the desk."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts
from tests.lab.exam.causes.cause import FORCE_Z, LINK_ROWS, Cause, Sizes


class StickyPatch(Cause):
    """Pull of the strip towards the desk, up to `pressure` [N/m^2] within `reach` [m] of the patch.

    The patch lies about the share `position` of the strip's length, `size` [m] long. Source:
    assumed; what is left of adhesive tape on a desk peels at 0.1 to 1 N per metre of width.
    """

    amount: ClassVar[str] = "pressure"
    sizes: ClassVar[Sizes] = {"medium": {"pressure": 50.0}, "strong": {"pressure": 300.0}}

    pressure: float = Field(ge=0, le=1000)
    position: float = Field(0.65, gt=0, lt=1)
    size: float = Field(0.1, gt=0, le=0.5)
    reach: float = Field(0.004, gt=0, le=0.02)  # m

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Downward pull on the links above the patch; None without pressure."""
        if self.pressure == 0:
            return None
        lumps, joints = parts.lumps, parts.joints
        force = self.pressure * parts.model.mechanics.width * lumps.spans * lumps.scale
        middle = self.position * float(lumps.spans.sum())

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, ___: float) -> None:
            nodes = joints.nodes(data.qpos)
            x, z = (0.5 * (nodes[1:, i] + nodes[:-1, i]) for i in range(2))
            near = np.clip(1.0 - np.maximum(z, 0.0) / self.reach, 0.0, 1.0)
            over_patch = np.abs(x - middle) < self.size / 2
            data.xfrc_applied[LINK_ROWS, FORCE_Z] -= force * near * over_patch

        return act


CAUSE = StickyPatch
