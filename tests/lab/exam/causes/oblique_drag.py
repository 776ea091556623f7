"""Hidden cause: drag of still air that also acts along the strip and is not quite quadratic."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts
from drivers.twin.chain.lumps import AIR_DENSITY
from tests.lab.exam.causes.air import LEAST_SPEED, drag_step, link_motion
from tests.lab.exam.causes.cause import FORCE_XZ, LINK_ROWS, Cause


class ObliqueDrag(Cause):
    """Drag per length 1/2 rho C width v_0^2 (|v| / v_0)^exponent, against the motion.

    Its part along the strip counts `along`. The coefficient is that of a plate in normal flow,
    C_d, at the speed v_0. Sources: Hoerner, Fluid-Dynamic Drag, 1965, chapter 3 (plates between
    laminar friction, exponent 1.5, and separated flow, 2); Taylor, Proc. R. Soc. A 214, 1952.
    """

    amount: ClassVar[str] = "coefficient"
    answers: ClassVar[str | None] = "air_drag"

    coefficient: float = Field(ge=0, le=100)
    along: float = Field(0.15, ge=0, le=1)
    exponent: float = Field(1.85, ge=1.2, le=2.2)
    speed: float = Field(0.3, gt=0, le=5)  # m/s, v_0

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Drag on every link; None without drag."""
        if self.coefficient == 0:
            return None
        lumps = parts.lumps
        size = 0.5 * AIR_DENSITY * self.coefficient * parts.model.mechanics.width
        size *= lumps.scale * self.speed**2

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, h: float) -> None:
            _middles, velocity, along = link_motion(parts.joints, data.qpos, data.qvel)
            speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), LEAST_SPEED)[:, None]
            tangential = (velocity * along).sum(axis=1)[:, None] * along
            way = (velocity - (1.0 - self.along) * tangential) / speed
            force = -size * lumps.spans[:, None] * (speed / self.speed) ** self.exponent * way
            data.xfrc_applied[LINK_ROWS, FORCE_XZ] += drag_step(parts, force, velocity, h)

        return act


CAUSE = ObliqueDrag
