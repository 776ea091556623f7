"""Hidden cause: electrostatic attraction between strip and desk."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts
from tests.lab.exam.causes.cause import FORCE_Z, LINK_ROWS, Cause, Sizes


class StaticCling(Cause):
    """Pull of the strip's face towards the desk, `pressure` [N/m^2] exp(-height / `reach`).

    Source: charged textiles hold some uC/m^2, that is sigma^2 / (2 eps_0) of 0.05 to 5 N/m^2;
    the reach, as for patches of charge of alternate sign, is assumed.
    """

    amount: ClassVar[str] = "pressure"
    sizes: ClassVar[Sizes] = {"medium": {"pressure": 5.0}, "strong": {"pressure": 15.0}}

    pressure: float = Field(ge=0, le=50)
    reach: float = Field(0.010, gt=0, le=0.1)  # m

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Downward pull on every link; None without pressure."""
        if self.pressure == 0:
            return None
        lumps, joints = parts.lumps, parts.joints
        size = self.pressure * parts.model.mechanics.width * lumps.spans * lumps.scale

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, ___: float) -> None:
            nodes = joints.nodes(data.qpos)
            height = np.maximum(0.5 * (nodes[1:, 1] + nodes[:-1, 1]), 0.0)
            facing = np.abs(np.diff(nodes[:, 0])) / lumps.spans  # share that faces the desk
            data.xfrc_applied[LINK_ROWS, FORCE_Z] -= size * facing * np.exp(-height / self.reach)

        return act


CAUSE = StaticCling
