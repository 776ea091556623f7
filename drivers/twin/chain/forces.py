"""Forces on a chain that MuJoCo has no field for, and the interface for extra
forces.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from drivers.base.geometry import left_normals
from drivers.base.types import Array
from drivers.strip.model import StripModel
from drivers.twin.chain.lumps import Lumps
from drivers.twin.chain.spec import Joints


class Loads:
    """Friction, relaxation and drag of one chain, computed before each step from its
    history.

    A chain steps like leapfrog: a force at the angles of a step's beginning is
    second-order accurate.
    """

    def __init__(self, lumps: Lumps, joints: Joints) -> None:
        hinges = lumps.hinges
        self._lumps = lumps
        self._joints = joints
        self._has_friction = bool(hinges.slip.any())
        self._relaxes = bool(hinges.fading.any())
        self._has_drag = bool(lumps.drag.any())
        self._angle = hinges.rest_angle * 0.0
        self._strain = hinges.rest_angle * 0.0  # of the Maxwell elements [rad]
        self._elapsed = 0.0

    def update(self, data: mujoco.MjData, h: float) -> None:
        """Write friction, relaxation and drag for a step of `h` [s] into the state
        `data`.
        """
        if self._has_friction or self._relaxes:
            data.qfrc_applied[self._joints.hinges] = self._moments(data, h)
        if self._has_drag:
            # bodies between world and tip plus gripper; force components x and z
            data.xfrc_applied[1:-2, :3:2] = self._drag(data, h)

    def _moments(self, data: mujoco.MjData, h: float) -> Array:
        """Moments (n + 1,) [N m] of friction and relaxation at the chain's n + 1
        hinges.
        """
        hinges = self._joints.hinges
        moment = np.zeros(len(hinges))
        if self._has_friction:
            # The engine takes the yarns' moment where the step would end. That damps
            # like h times their stiffness, even while they slide; its share at the
            # present rate is taken back.
            moment += h * self._lumps.hinges.presliding * data.qvel[hinges]
        if self._relaxes:
            moment += self._relax(data.qpos[hinges], h)
        return moment

    def _relax(self, angle: Array, h: float) -> Array:
        """Moments (n + 1,) [N m] by which relaxing (Maxwell) elements weaken the
        springs of the chain's n + 1 hinges.

        Their strain obeys dq/dt = dangle/dt - q / time; exact for a uniform rate
        between calls.
        """
        lumps = self._lumps.hinges
        periods = self._elapsed / lumps.fading_time
        retained = -np.expm1(-periods) / periods if periods > 0 else 1.0
        self._strain = np.exp(-periods) * self._strain + retained * (
            angle - self._angle
        )
        self._angle = angle.copy()
        self._elapsed = h
        return lumps.fading * (angle - lumps.rest_angle - self._strain)

    def _drag(self, data: mujoco.MjData, h: float) -> Array:
        """Air drag (n, 2) [N] along x and z on the chain's n links, against their
        motion.

        Divided by what an implicit step of an isolated link would slow it down by, so
        that light strips stay stable.
        """
        lumps = self._lumps
        air = lumps.air
        speed, tangents = self._joints.speeds(data.qpos, data.qvel)
        along, across = speed.T
        resistance = lumps.drag * (
            np.sqrt(across**2 + air.oblique * along**2) + air.slow
        )
        slowed = resistance / (1.0 + h * resistance / lumps.mass)
        friction = (slowed * air.along * along)[:, None]
        pressure = (slowed * across)[:, None]
        force: Array = -friction * tangents - pressure * left_normals(tangents)
        return force


class DahlFriction:
    """Friction moments of Dahl's elements with the `limit` (n,) [N m] and the
    `stiffness` (n,) [N m/rad].

    dM/dangle = stiffness (1 - s M / limit)^exponent, where s is the sign of the rate.
    Source: Dahl, Solid friction damping of mechanical vibrations, AIAA Journal 14(12),
    1976.
    """

    def __init__(self, limit: Array, stiffness: Array, exponent: float) -> None:
        self._limit = limit
        self._stiffness = stiffness
        self._exponent = exponent
        self._moment = 0.0 * limit
        self._angle = 0.0 * limit

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:  # noqa: ARG002
        """Friction moments (n,) [N m] at the hinges' angles `angle` (n,) [rad], and
        their slopes (n,) [N m/rad].
        """
        limit = self._limit
        turn = angle - self._angle
        sign = np.where(turn < 0, -1.0, 1.0)
        # 0 in full sliding, 2 at a reversal
        reserve = 1.0 - sign * self._moment / limit
        travel = self._stiffness * np.abs(turn) / limit
        self._moment = sign * limit * (1.0 - _decay(reserve, travel, self._exponent))
        self._angle = angle
        ahead = np.where(rate < 0, -1.0, 1.0)  # direction in which the hinge turns next
        reserve = np.clip(1.0 - ahead * self._moment / limit, 0.0, 2.0)
        return self._moment, self._stiffness * reserve**self._exponent


def _decay(start: Array, x: Array, exponent: float) -> Array:
    """Solution u (n,) of du/dx = -u^exponent at `x` (n,), from u = `start` (n,) at
    0.
    """
    start = np.maximum(start, 1e-12)  # a power below would divide by zero
    if exponent == 1:
        return start * np.exp(-x)
    power = exponent - 1.0
    return (start**-power + power * x) ** (-1.0 / power)


@dataclass(frozen=True, slots=True)
class Parts:
    """Properties of a chain that an extra force may read: model of the strip,
    coefficients of its links, indices of its joints.
    """

    model: StripModel
    lumps: Lumps
    joints: Joints


ForceFunction = Callable[[mujoco.MjModel, mujoco.MjData, float, float], None]
"""An extra force on one chain, called with model, data, time and h before each step.

It adds to the applied forces and the damping of the step of h [s] that begins at time
[s]:
`data.qfrc_applied`, `data.xfrc_applied` and `model.dof_damping` hold what the chain has
by itself, in the chain's own unit of mass. It may remember the past of its strip.
"""


ExtraForce = Callable[[Parts], ForceFunction | None]
"""An extra force: attached to one chain that lies flat and at rest, it returns its
function.

None where it exerts none.
"""


class ExtraForces:
    """Forces and damping of effects that MuJoCo lacks, added to one chain before each
    step.
    """

    def __init__(self, laws: Sequence[ExtraForce], parts: Parts) -> None:
        self._lumps = parts.lumps
        self._hinges = parts.joints.hinges
        forces = [law(parts) for law in laws]
        self._forces = [force for force in forces if force is not None]
        self._damping: Array = np.zeros(0)

    def clear(self, model: mujoco.MjModel, data: mujoco.MjData, h: float) -> None:
        """Reset the applied forces and the damping of the last step, if there are extra
        forces.
        """
        if self._forces:
            data.qfrc_applied[:] = 0.0
            data.xfrc_applied[:] = 0.0
            model.dof_damping[self._hinges] = self._lumps.hinges.damping_at(h)

    def add(
        self, model: mujoco.MjModel, data: mujoco.MjData, time: float, h: float
    ) -> None:
        """Add all extra forces to the step of `h` [s] that begins at `time` [s]."""
        for force in self._forces:
            force(model, data, time, h)
        if self._forces:
            self._damping = model.dof_damping.copy()

    def restore_damping(self, model: mujoco.MjModel) -> None:
        """Set the joints' damping of a recompiled `model` to that after the last
        `add`.
        """
        if self._forces:
            model.dof_damping[:] = self._damping


MomentLaw = Callable[[Array, Array, float], tuple[Array, Array]]
"""A moment that resists bending: of hinge angles (n + 1,), their rates and the step h
[s].

Returns the moment (n + 1,) [N m] and its slope (n + 1,) [N m/rad]; it may remember the
past.
"""


def resistance(parts: Parts, law: MomentLaw) -> ForceFunction:
    """Extra force from a moment `law` at the hinges, with the damping that keeps steps
    stable.

    A step of h with the moment at its end is equivalent to a damper of h times the
    slope; its force at the present rate is subtracted, so that in steady motion only
    the moment remains.
    """
    hinges = parts.joints.hinges

    def act(model: mujoco.MjModel, data: mujoco.MjData, _: float, h: float) -> None:
        rate = data.qvel[hinges]
        moment, slope = law(data.qpos[hinges].copy(), rate, h)
        ahead = h * np.maximum(slope, 0.0)
        model.dof_damping[hinges] += ahead
        data.qfrc_applied[hinges] += ahead * rate - moment

    return act


def _fifth_order(parts: Parts) -> ForceFunction:
    """Extra force of the strip's elastic moment that grows with the fifth power of the
    bend.
    """
    lumps = parts.lumps.hinges

    def law(angle: Array, rate: Array, h: float) -> tuple[Array, Array]:  # noqa: ARG001
        bent = angle - lumps.rest_angle
        return lumps.fifth * bent**5, 5.0 * lumps.fifth * bent**4

    return resistance(parts, law)


def gradual_friction(parts: Parts) -> ForceFunction:
    """Extra force of friction between the yarns that sets in gradually, without a yield
    point, after Dahl.
    """
    lumps = parts.lumps.hinges
    return resistance(
        parts, DahlFriction(lumps.gradual_limit, lumps.gradual, exponent=1.0)
    )


def strip_laws(model: StripModel) -> Sequence[ExtraForce]:
    """Extra forces for those terms of the strip's bending moment that MuJoCo's joints
    lack.
    """
    law = model.mechanics.law
    laws = list[ExtraForce]()
    if law.cubic != 0 and law.fifth != 0:
        laws.append(_fifth_order)
    if law.yield_curvature != 0 and law.gradual != 0:
        laws.append(gradual_friction)
    return laws
