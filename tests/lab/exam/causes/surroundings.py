"""Hidden causes around the strip: air that moves, and a desk that holds on to it."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.base.types import Array
from drivers.strip.model import AIR_DENSITY
from drivers.twin.chain.forces import ForceFunction, Parts
from drivers.twin.chain.spec import Joints
from tests.lab.exam.causes.cause import FORCE_XZ, FORCE_Z, LINK_ROWS, Cause, Sizes

TINY = 1e-6  # s, over which nodes are led on to see how fast they move
LEAST_SPEED = 1e-9  # m/s, in place of a speed of zero where one divides by it


def link_motion(
    joints: Joints, position: Array, rate: Array
) -> tuple[Array, Array, Array]:
    """Midpoints (n, 2) [m] of the links, their velocities (n, 2) [m/s] and directions
    (n, 2).
    """
    nodes = joints.nodes(position)
    speed = (joints.nodes(position + TINY * rate) - nodes) / TINY
    along = np.diff(nodes, axis=0)
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    return 0.5 * (nodes[1:] + nodes[:-1]), 0.5 * (speed[1:] + speed[:-1]), along


def drag_step(parts: Parts, force: Array, speed: Array, h: float) -> Array:
    """Drag `force` (n, 2) at velocity `speed` (n, 2) [m/s], reduced as by an implicit
    step `h` [s].

    Each link is stepped alone. Without this light strips are thrown back and forth.
    """
    size = np.hypot(force[:, 0], force[:, 1])
    # of v^2
    slope = 2.0 * size / np.maximum(np.hypot(speed[:, 0], speed[:, 1]), LEAST_SPEED)
    return np.asarray(force / (1.0 + h * slope / parts.lumps.mass)[:, None])


LAYER = 0.10  # m over the desk, where the wind has its full speed
WIND_EXPONENT = 1 / 7  # of the wind's profile below that


class Draught(Cause):
    """Drag of the strip in a gusty wind of mean `speed` [m/s] along +x.

    Drag C_d normal to the links, gusts as an Ornstein-Uhlenbeck process of relative
    size
    `gusts` and memory `memory` [s], a boundary layer z^(1/7) over the desk. Source:
    air-conditioned rooms have 0.1 to 0.4 m/s with turbulence of 40 % (ISO 7730, draught
    rating).
    """

    amount: ClassVar[str] = "speed"
    sizes: ClassVar[Sizes] = {"medium": {"speed": 0.35}, "strong": {"speed": 0.55}}

    speed: float = Field(ge=-2, le=2)  # m/s
    gusts: float = Field(0.3, ge=0, le=1)
    memory: float = Field(0.8, gt=0, le=60)  # s
    drag: float = Field(1.2, ge=0, le=10)  # C_d

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Drag of the wind on every link."""
        lumps = parts.lumps
        size = (
            0.5
            * AIR_DENSITY
            * self.drag
            * parts.model.mechanics.width
            * lumps.spans
            * lumps.scale
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
            data.xfrc_applied[LINK_ROWS, FORCE_XZ] += drag_step(
                parts, force, relative, h
            )

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


class ObliqueDrag(Cause):
    """Drag per length 1/2 rho C width v_0^2 (|v| / v_0)^exponent, against the motion.

    Its part along the strip counts `along`. The coefficient is that of a plate in
    normal flow, C_d, at the speed v_0. Sources: Hoerner, Fluid-Dynamic Drag, 1965,
    chapter 3 (plates between laminar friction, exponent 1.5, and separated flow, 2);
    Taylor, Proc. R. Soc. A 214, 1952.
    """

    amount: ClassVar[str] = "coefficient"
    answers: ClassVar[str | None] = "air_drag"

    coefficient: float = Field(ge=0, le=100)
    along: float = Field(0.15, ge=0, le=1)
    exponent: float = Field(1.85, ge=1.2, le=2.2)
    speed: float = Field(0.3, gt=0, le=5)  # m/s, v_0

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Drag on every link."""
        lumps = parts.lumps
        size = 0.5 * AIR_DENSITY * self.coefficient * parts.model.mechanics.width
        size *= lumps.scale * self.speed**2

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, h: float) -> None:
            _middles, velocity, along = link_motion(parts.joints, data.qpos, data.qvel)
            speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), LEAST_SPEED)[
                :, None
            ]
            tangential = (velocity * along).sum(axis=1)[:, None] * along
            way = (velocity - (1.0 - self.along) * tangential) / speed
            force = (
                -size
                * lumps.spans[:, None]
                * (speed / self.speed) ** self.exponent
                * way
            )
            data.xfrc_applied[LINK_ROWS, FORCE_XZ] += drag_step(
                parts, force, velocity, h
            )

        return act


class StaticCling(Cause):
    """Pull of the strip's face towards the desk, `pressure` [N/m^2] exp(-height /
    `reach`).

    Source: charged textiles hold some uC/m^2, that is sigma^2 / (2 eps_0) of 0.05 to 5
    N/m^2; the reach, as for patches of charge of alternate sign, is assumed.
    """

    amount: ClassVar[str] = "pressure"
    sizes: ClassVar[Sizes] = {"medium": {"pressure": 5.0}, "strong": {"pressure": 15.0}}

    pressure: float = Field(ge=0, le=50)
    reach: float = Field(0.010, gt=0, le=0.1)  # m

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Downward pull on every link."""
        lumps, joints = parts.lumps, parts.joints
        size = self.pressure * parts.model.mechanics.width * lumps.spans * lumps.scale

        def act(_: mujoco.MjModel, data: mujoco.MjData, __: float, ___: float) -> None:
            nodes = joints.nodes(data.qpos)
            height = np.maximum(0.5 * (nodes[1:, 1] + nodes[:-1, 1]), 0.0)
            # share that faces the desk
            facing = np.abs(np.diff(nodes[:, 0])) / lumps.spans
            data.xfrc_applied[LINK_ROWS, FORCE_Z] -= (
                size * facing * np.exp(-height / self.reach)
            )

        return act


class StickyPatch(Cause):
    """Pull of the strip towards the desk, up to `pressure` [N/m^2] within `reach` [m]
    of the patch.

    The patch lies about the share `position` of the strip's length, `size` [m] long.
    Source: assumed; what is left of adhesive tape on a desk peels at 0.1 to 1 N per
    metre of width.
    """

    amount: ClassVar[str] = "pressure"
    sizes: ClassVar[Sizes] = {
        "medium": {"pressure": 50.0},
        "strong": {"pressure": 300.0},
    }

    pressure: float = Field(ge=0, le=1000)
    position: float = Field(0.65, gt=0, lt=1)
    size: float = Field(0.1, gt=0, le=0.5)
    reach: float = Field(0.004, gt=0, le=0.02)  # m

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Downward pull on the links above the patch."""
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


class CaughtThread(Cause):
    """Thread from the strip to the desk under it, which tears for good at a pull of
    `strength` [N].

    It is slack for its `length`, then pulls by `stiffness` times what is drawn out of
    the weave. Source: assumed; drawing one yarn out of a woven strip takes 0.01 to 0.1
    N.
    """

    amount: ClassVar[str] = "strength"
    sizes: ClassVar[Sizes] = {
        "medium": {"strength": 0.012},
        "strong": {"strength": 0.022},
    }

    strength: float = Field(ge=0, le=1)  # N
    position: float = Field(0.7, gt=0.05, lt=0.95)  # share of the strip's length
    length: float = Field(0.03, ge=0, le=0.3)  # m
    stiffness: float = Field(0.5, gt=0, le=5)  # N/m

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Pull of the thread on the link that it is tied to."""
        ends = np.cumsum(parts.lumps.spans)
        place = self.position * ends[-1]
        return _Thread(
            self, parts, int(np.searchsorted(ends, place)), np.array([place, 0.0])
        )


@dataclass(slots=True)
class _Thread:
    """Force function of a thread from the middle of link `link` to its `foot` (2,) on
    the desk.
    """

    cause: CaughtThread
    parts: Parts
    link: int
    foot: Array
    whole: bool = True

    def __call__(
        self, _: mujoco.MjModel, data: mujoco.MjData, __: float, ___: float
    ) -> None:
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
