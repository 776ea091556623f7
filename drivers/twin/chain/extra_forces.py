"""Extension point: extra forces on a chain that are not part of the strip's description."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from drivers.strip.model import StripModel
from drivers.twin.chain.dahl import DahlFriction
from drivers.twin.chain.joints import Joints
from drivers.twin.chain.lumps import Lumps
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Parts:
    """Quantities of a chain that an extra force may read."""

    model: StripModel
    lumps: Lumps
    joints: Joints


ForceFunction = Callable[[mujoco.MjModel, mujoco.MjData, float, float], None]
"""An extra force on one chain, called with model, data, time and h before each step.

It adds to the applied forces and the damping of the step of h [s] that begins at time [s]:
`data.qfrc_applied`, `data.xfrc_applied` and `model.dof_damping` hold what the chain has by
itself, in the chain's own unit of mass. It may remember the past of its strip.
"""


class ExtraForce(Protocol):
    """An extra force, attached to chains by `begin`."""

    def begin(self, parts: Parts) -> ForceFunction:
        """Attach the force to one chain that lies flat and at rest; returns its function."""


class ExtraForces:
    """The extra forces that act on one chain, and the damping that they add."""

    def __init__(self, laws: Sequence[ExtraForce], parts: Parts) -> None:
        self._lumps, self._hinges = parts.lumps, parts.joints.hinges
        self._acts = [law.begin(parts) for law in laws]
        self._damping: Array = np.zeros(0)

    def clear(self, model: mujoco.MjModel, data: mujoco.MjData, h: float) -> None:
        """Reset the applied forces and the damping of the last step, if there are extra forces."""
        if self._acts:
            data.qfrc_applied[:] = 0.0
            data.xfrc_applied[:] = 0.0
            model.dof_damping[self._hinges] = self._lumps.damping_at(h)

    def add(self, model: mujoco.MjModel, data: mujoco.MjData, time: float, h: float) -> None:
        """Add all extra forces to the next step."""
        for act in self._acts:
            act(model, data, time, h)
        self._damping = model.dof_damping.copy() if self._acts else self._damping

    def restore_damping(self, model: mujoco.MjModel) -> None:
        """Copy the damping of this step into the `model` of a recompiled chain."""
        if self._acts:
            model.dof_damping[:] = self._damping


class MomentLaw(Protocol):
    """A moment that resists bending, as a function of all hinge angles and their history."""

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Moment (n + 1,) [N m] and its slope (n + 1,) [N m/rad], for a step of `h` [s]."""


def resistance(parts: Parts, law: MomentLaw) -> ForceFunction:
    """An extra force from a moment law, with the damping that keeps the step stable.

    A step of h with the moment at its end is equivalent to a damper of h times the slope; its force
    at the present rate is subtracted, so that in steady motion only the moment remains.
    """
    hinges = parts.joints.hinges

    def act(model: mujoco.MjModel, data: mujoco.MjData, _: float, h: float) -> None:
        angle, rate = data.qpos[hinges], data.qvel[hinges]
        moment, slope = law(angle.copy(), rate, h)
        ahead = h * np.maximum(slope, 0.0)
        model.dof_damping[hinges] += ahead
        data.qfrc_applied[hinges] += ahead * rate - moment

    return act


class FifthOrder:
    """Extra force of the fifth-order term of the elastic bending law."""

    def begin(self, parts: Parts) -> ForceFunction:
        """Attach the moment to the hinges of one chain; returns its function."""
        lumps = parts.lumps

        def law(angle: Array, rate: Array, h: float) -> tuple[Array, Array]:  # noqa: ARG001
            bent = angle - lumps.rest
            return lumps.fifth * bent**5, 5.0 * lumps.fifth * bent**4

        return resistance(parts, law)


class GradualFriction:
    """Extra force of the yarns' friction that has no yield point."""

    def begin(self, parts: Parts) -> ForceFunction:
        """Attach the moment to the hinges of one chain; returns its function."""
        lumps = parts.lumps
        law = DahlFriction(lumps.gradual_limit, lumps.gradual, exponent=1.0)
        return resistance(parts, law)


def own_laws(model: StripModel) -> Sequence[ExtraForce]:
    """Extra forces that simulate terms of the strip's own bending law."""
    law = model.mechanics.law
    fifth = (FifthOrder(),) if law.cubic != 0 and law.fifth != 0 else ()
    rubs = law.yield_curvature != 0 and law.gradual != 0
    return (*fifth, GradualFriction()) if rubs else fifth
