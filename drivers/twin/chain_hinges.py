"""Moments at the hinges of a chain that its engine has no field for."""

from collections.abc import Sequence
from typing import Protocol

import mujoco
import numpy as np

from drivers.strip.model import StripModel
from drivers.twin.chain_foreign import Act, Foreign, Parts
from drivers.types import Array


class MomentLaw(Protocol):
    """A moment that resists bending, as a function of the angles of all hinges and their past."""

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Moment (n + 1,) [N m] and its slope (n + 1,) [N m/rad], for a step of `h` [s]."""
        ...


def resisted(parts: Parts, law: MomentLaw) -> Act:
    """The law at work: its moment, and what a step must be damped by to stay stable.

    A step of h that takes the moment at its end has h times the slope as a damper; the share of
    it at the present rate is given back, so that in even motion the moment alone is felt.
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
    """What the law of bending has beyond its cubic term."""

    def begin(self, parts: Parts) -> Act:
        """The moment at every hinge."""
        lumps = parts.lumps

        def law(angle: Array, rate: Array, h: float) -> tuple[Array, Array]:  # noqa: ARG001
            bent = angle - lumps.rest
            return lumps.fifth * bent**5, 5.0 * lumps.fifth * bent**4

        return resisted(parts, law)


def own_laws(model: StripModel) -> Sequence[Foreign]:
    """Laws of the strip itself that are simulated like foreign ones."""
    law = model.mechanics.law
    return (FifthOrder(),) if law.cubic != 0 and law.fifth != 0 else ()
