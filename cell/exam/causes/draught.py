"""Cause: a gusty wind over the desk."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from cell.exam.causes.air import drag_step, moving
from cell.exam.causes.cause import Cause, Sizes
from drivers.twin.chain.extra_forces import ForceFunction, Parts
from drivers.twin.chain.lumps import AIR_DENSITY

LAYER = 0.10  # m over the desk, where the wind has its full speed
WIND_EXPONENT = 1 / 7  # of the wind below


class Draught(Cause):
    """Drag of the strip in a gusty wind of mean `speed` [m/s] along +x.

    Drag C_d normal to the links, gusts as an Ornstein-Uhlenbeck process of relative size
    `gusts` and memory `memory` [s], a boundary layer z^(1/7) over the desk. Source: air-conditioned
    rooms have 0.1 to 0.4 m/s with turbulence of 40 % (ISO 7730, draught rating).
    """

    amount: ClassVar[str] = "speed"
    sizes: ClassVar[Sizes] = {"medium": {"speed": 0.35}, "strong": {"speed": 0.55}}

    speed: float = Field(ge=-2, le=2)  # m/s
    gusts: float = Field(0.3, ge=0, le=1)
    memory: float = Field(0.8, gt=0, le=60)  # s
    drag: float = Field(1.2, ge=0, le=10)  # C_d

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Wind on every link."""
        if self.speed == 0:
            return None
        lumps = parts.lumps
        size = (
            0.5 * AIR_DENSITY * self.drag * parts.model.mechanics.width * lumps.spans * lumps.scale
        )
        gust = float(rng.standard_normal())

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, h: float) -> None:
            nonlocal gust
            kept = float(np.exp(-h / self.memory))
            gust = kept * gust + float(np.sqrt(1.0 - kept**2)) * float(rng.standard_normal())
            middles, speed, along = moving(parts.joints, data.qpos, data.qvel)
            wind = self.speed * (1.0 + self.gusts * gust)
            slow = np.clip(middles[:, 1] / LAYER, 0.0, 1.0) ** WIND_EXPONENT
            relative = speed - wind * np.stack([slow, 0.0 * slow], axis=1)
            normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
            across = (relative * normals).sum(axis=1)
            force = -(size * np.abs(across) * across)[:, None] * normals
            data.xfrc_applied[1:-2, :3:2] += drag_step(parts, force, relative, h)

        return act


CAUSE = Draught
