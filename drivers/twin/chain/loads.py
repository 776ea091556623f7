"""Forces on a chain that MuJoCo has no field for: yarn friction, relaxation, air drag."""

import mujoco
import numpy as np

from drivers.twin.chain.joints import Joints
from drivers.twin.chain.lumps import Lumps
from drivers.types import Array


class Loads:
    """Applied forces of one chain, computed before each step; keeps the history of its strip.

    A chain steps like leapfrog: a force at the angles of a step's beginning is second-order
    accurate.
    """

    def __init__(self, lumps: Lumps, joints: Joints) -> None:
        self._lumps, self._joints = lumps, joints
        self._rubs, self._fades = bool(lumps.slip.any()), bool(lumps.fading.any())
        self._blown = bool(lumps.drag.any())
        self._angle = lumps.rest * 0.0
        self._strain = lumps.rest * 0.0  # of the Maxwell elements [rad]
        self._elapsed = 0.0

    def renew(self, data: mujoco.MjData, h: float) -> None:
        """Compute the forces for a step of `h` [s] from the state of `data`."""
        if self._rubs or self._fades:
            data.qfrc_applied[self._joints.hinges] = self._moments(data, h)
        if self._blown:
            # bodies between world and tip plus gripper; force components x and z
            data.xfrc_applied[1:-2, :3:2] = self._drag(data, h)

    def _moments(self, data: mujoco.MjData, h: float) -> Array:
        """Moments (n + 1,) of friction and relaxation at the hinges."""
        lumps, hinges = self._lumps, self._joints.hinges
        moment = np.zeros(len(hinges))
        if self._rubs:
            # The engine takes the yarns' moment where the step would end. That damps like h times
            # their stiffness, even while they slide; its share at the present rate is taken back.
            moment += h * lumps.presliding * data.qvel[hinges]
        if self._fades:
            moment += self._fade(data.qpos[hinges], h)
        return moment

    def _fade(self, angle: Array, h: float) -> Array:
        """Moments (n + 1,) by which Maxwell elements have relaxed below springs.

        Their strain obeys dq/dt = dangle/dt - q / time; exact for a uniform rate between calls.
        """
        lumps = self._lumps
        periods = self._elapsed / lumps.fading_time
        kept = -np.expm1(-periods) / periods if periods > 0 else 1.0
        self._strain = np.exp(-periods) * self._strain + kept * (angle - self._angle)
        self._angle, self._elapsed = angle.copy(), h
        return np.asarray(lumps.fading * (angle - lumps.rest - self._strain))

    def _drag(self, data: mujoco.MjData, h: float) -> Array:
        """Drag forces (n, 2) on the links against their motion.

        Divided by what an implicit step of an isolated link would slow it down by, so that light
        strips stay stable.
        """
        air, (speed, tangents) = self._lumps.air, self._joints.speeds(data.qpos, data.qvel)
        along, across = speed.T
        resistance = self._lumps.drag * (np.sqrt(across**2 + air.oblique * along**2) + air.slow)
        slowed = resistance / (1.0 + h * resistance / self._lumps.mass)
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
        rubbed, pushed = (slowed * air.along * along)[:, None], (slowed * across)[:, None]
        return np.asarray(-rubbed * tangents - pushed * normals)
