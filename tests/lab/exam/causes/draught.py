"""Hidden cause: a gusty wind over the desk."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts
from drivers.twin.chain.lumps import AIR_DENSITY
from tests.lab.exam.causes.air import drag_step, link_motion
from tests.lab.exam.causes.cause import FORCE_XZ, LINK_ROWS, Cause, Sizes

LAYER = 0.10  # m over the desk, where the wind has its full speed
WIND_EXPONENT = 1 / 7  # of the wind's profile below that


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
        """Drag of the wind on every link; None without wind."""
        if self.speed == 0:
            return None
        lumps = parts.lumps
        size = (
            0.5 * AIR_DENSITY * self.drag * parts.model.mechanics.width * lumps.spans * lumps.scale
        )
        gusts = _Gusts(self.memory, rng)

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, h: float) -> None:
            wind = self.speed * (1.0 + self.gusts * gusts.advance(h))
            middles, velocity, along = link_motion(parts.joints, data.qpos, data.qvel)
            profile = np.clip(middles[:, 1] / LAYER, 0.0, 1.0) ** WIND_EXPONENT
            relative = velocity - wind * np.stack([profile, 0.0 * profile], axis=1)
            normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
            across = (relative * normals).sum(axis=1)
            force = -(size * np.abs(across) * across)[:, None] * normals
            data.xfrc_applied[LINK_ROWS, FORCE_XZ] += drag_step(parts, force, relative, h)

        return act


class _Gusts:
    """Ornstein-Uhlenbeck process of zero mean and unit variance with `memory` [s]."""

    def __init__(self, memory: float, rng: np.random.Generator) -> None:
        self._memory, self._rng = memory, rng
        self._value = float(rng.standard_normal())

    def advance(self, h: float) -> float:
        """Value of the process after a step of `h` [s]."""
        kept = float(np.exp(-h / self._memory))
        fresh = float(np.sqrt(1.0 - kept**2)) * float(self._rng.standard_normal())
        self._value = kept * self._value + fresh
        return self._value


CAUSE = Draught
