"""Closed kinematic loops: equality constraints by which joints depend on independent
ones.

With the Jacobian J of the equalities and N, whose columns are the motions that J
allows, the torque tau of motors with transmissions B follows from inverse dynamics f of
the open tree without the forces in the loops: N^T B tau = N^T f. It depends on geometry
alone.
"""

import copy
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array

# of the largest singular value; smaller rows of a Jacobian repeat others
RANK_TOLERANCE = 1e-6
# from the stated pose, which closes the loops, to the first measured one
APPROACH_STEPS = 50
NEWTON_STEPS, GAP_TOLERANCE = 20, 1e-10  # at most; m or rad, at which they end
# rad or m about the stated pose, where no Jacobian is singular by chance
PERTURBATION = 0.01
# of N^T B; beyond, as at a dead centre, motors do not move the loop
LARGEST_CONDITION = 100.0


def transmissions(model: Any, data: Any) -> Array:
    """Moment arms of the actuators in the pose of `data`, whose positions MuJoCo has
    computed, as an array of shape (actuators, degrees of freedom).
    """
    dense = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        dense,
        data.actuator_moment,
        data.moment_rownnz,
        data.moment_rowadr,
        data.moment_colind,
    )
    return dense


class ClosedLoops:
    """Closed kinematic loops of a model, in which the positions of some joints, listed
    in `independent`, determine those of the others by equality constraints.

    The joints numbered `inputs` are measured; of these, those with a motor lead. Joints
    that `stand` at their stated pose are neither measured nor in a loop with the
    joints numbered `compared`, of whose motors torques are; what is `apart` (joints,)
    is in no loop with these. Raises ConfigurationError, with the mechanism's `origin`,
    where motors are not as many as the degrees of freedom, or a measured joint is
    missing.
    """

    def __init__(
        self, model: Any, inputs: Sequence[int], compared: Sequence[int], origin: str
    ) -> None:
        self._model = _with_equalities_alone(model)
        self._data = mujoco.MjData(self._model)
        perturbed = np.random.default_rng(0).normal(model.qpos0, PERTURBATION)
        jacobian, _ = self._jacobian(perturbed)
        motions = null_space(jacobian, RANK_TOLERANCE)
        if model.nu != (count := motions.shape[1]):
            raise ConfigurationError(
                f"{origin}: model: its closed loops leave {count} degrees of freedom,"
                f" and it has {model.nu} motors; as many are needed: add or remove some"
            )

        # measured ones first, and of these the driven ones
        driven: Array = np.any(transmissions(self._model, self._data), axis=0)
        order = sorted(range(model.nv), key=lambda j: (j not in inputs, not driven[j]))
        independent = self.independent = np.sort(_leading(motions, order))
        self._dependent = np.setdiff1d(np.arange(model.nv), independent)
        together = motions @ np.linalg.inv(motions[independent])
        moved = np.abs(together) > RANK_TOLERANCE
        with_compared = moved[list(compared)].any(axis=0)
        self.apart = ~moved[:, with_compared].any(axis=1)
        self.stand = [j for j in independent if j not in inputs]
        missing = [model.joint(j).name for j in self.stand if not self.apart[j]]
        if missing:
            raise ConfigurationError(
                f"{origin}: inputs.{missing[0]}: is missing; a joint of each degree of"
                " freedom in a closed loop is measured: add it as position, or another"
                " of its loop"
            )

    def _jacobian(self, q: Array) -> tuple[Array, Array]:
        """Jacobian of the equality constraints, a row for each constraint and a column
        for each joint, and by how much each is violated at the joint positions `q`.
        """
        data = self._data
        data.qpos[:] = q
        mujoco.mj_fwdPosition(self._model, data)
        rows = data.nefc
        return data.efc_J[: rows * len(q)].reshape(rows, -1), data.efc_pos[:rows]

    def close(self, angles: Array) -> Array:
        """Positions of all joints with loops closed, a row for each row of `angles`,
        which holds the positions of the independent joints.
        """
        q = np.array(self._model.qpos0)
        found = []
        independent = self.independent
        dependent = self._dependent

        approach = np.linspace(q[independent], angles[0], APPROACH_STEPS)
        for each in (*approach, *angles):
            q[independent] = each
            for _ in range(NEWTON_STEPS):
                jacobian, gap = self._jacobian(q)
                if np.abs(gap).max() < GAP_TOLERANCE:
                    break
                inverse = np.linalg.pinv(jacobian[:, dependent], RANK_TOLERANCE)
                q[dependent] -= inverse @ gap
            found.append(q.copy())

        return np.array(found[APPROACH_STEPS:])

    def maps(self, q: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Linear maps between the joints of the closed loops and those of the opened
        ones, one of each for every row of the joint positions `q`, of shape (poses,
        joints).

        Forces of motors by torques of joints (m, actuators, n), motions of all joints
        by those of the independent ones (m, n, k), and whether the motors move the loop
        there (m,).
        """
        forces = []
        motions = []
        movable = []
        independent = self.independent
        dependent = self._dependent
        free = np.eye(len(independent))

        for row in q:
            jacobian, gap = self._jacobian(row)
            allowed = np.zeros((len(row), len(free)))
            allowed[independent] = free
            inner = np.linalg.pinv(jacobian[:, dependent], RANK_TOLERANCE)
            allowed[dependent] = -inner @ jacobian[:, independent]
            driven = allowed.T @ transmissions(self._model, self._data).T
            forces.append(np.linalg.pinv(driven, RANK_TOLERANCE) @ allowed.T)
            motions.append(allowed)
            closed = np.abs(gap).max() < np.sqrt(GAP_TOLERANCE)
            movable.append(closed and np.linalg.cond(driven) < LARGEST_CONDITION)

        return np.array(forces), np.array(motions), np.array(movable)

    def gap(self, q: Array) -> float:
        """Root mean square [m or rad] by which the joint positions `q`, a row for each
        pose, leave the loops open.
        """
        squares = []
        for row in q:
            _, gap = self._jacobian(row)
            squares.append(gap @ gap)  # before the next pose is written over it
        return float(np.sqrt(np.mean(squares)))


def _with_equalities_alone(model: Any) -> Any:
    """Copy of the MuJoCo `model` in which only equality constraints act: contacts, dry
    friction and joint limits are off.
    """
    copied = copy.copy(model)
    off = mujoco.mjtDisableBit
    copied.opt.disableflags = (
        off.mjDSBL_CONTACT | off.mjDSBL_FRICTIONLOSS | off.mjDSBL_LIMIT
    )
    copied.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return copied


def _leading(motions: Array, order: Sequence[int]) -> list[int]:
    """Numbers of the first joints, taken in the given `order`, whose rows of `motions`
    are linearly independent, so that they determine the motion of all joints.
    """
    leading: list[int] = []
    for joint in order:
        if np.linalg.matrix_rank(motions[[*leading, joint]]) > len(leading):
            leading.append(joint)
    return leading
