"""Differential inverse kinematics: tool pose and elbow angle determine all joints at each tick."""

from math import atan2, cos, hypot, sin

import numpy as np

from drivers.franka.kinematics import pose_and_jacobian
from drivers.types import Array

ELBOW_JOINT = 2  # its angle is the elbow's, as libfranka defines it
INVERSE_DAMPING = 1e-4
CONVERGED = 1e-6  # rad, a step of Newton's that ends a search
SMALL_SINE = 1e-6  # of an angle, below which dividing by the sine loses precision


def joint_step(q: Array, reached: Array, jac: Array, target: Array, elbow: float) -> Array:
    """Step (7,) [rad] of joints (7,) towards tool pose `target` (4, 4) and elbow angle [rad].

    `reached` (4, 4) and `jac` (6, 7) are what `pose_and_jacobian` gives for `q`. One Newton step:
    exact up to the square of the distance, so that what is missing after one tick is made up in
    the next. Damped, and so bounded, in singular postures.
    """
    wanted = np.empty(7)
    wanted[:3] = target[:3, 3] - reached[:3, 3]
    wanted[3:6] = rotation_vector(target[:3, :3] @ reached[:3, :3].T)
    wanted[6] = elbow - q[ELBOW_JOINT]
    return joint_rates(jac, wanted)


def track(
    q: Array, pose: Array, elbow: float, iterations: int, tolerance: float = CONVERGED
) -> tuple[Array, Array] | None:
    """Joints (7,) [rad] near `q` (7,) with the tool at `pose` (4, 4), and a Jacobian (6, 7) there.

    The elbow stands at `elbow` [rad]. None where the last of at most `iterations` Newton steps is
    not below `tolerance` [rad].
    """
    for _ in range(iterations):
        reached, jac = pose_and_jacobian(q)
        step = joint_step(q, reached, jac, pose, elbow)
        q = q + step
        size = float(np.abs(step).max())
        if size < CONVERGED:
            break
    return (q, jac) if size < tolerance else None


def joint_rates(jac: Array, wanted: Array) -> Array:
    """Joint rates (7,) for tool twist and elbow rate `wanted` (7,), by Jacobian `jac` (6, 7)."""
    whole = np.zeros((7, 7))
    whole[:6] = jac
    whole[6, ELBOW_JOINT] = 1
    square = whole @ whole.T
    square.flat[::8] += INVERSE_DAMPING**2
    return np.asarray(whole.T @ np.linalg.solve(square, wanted), dtype=np.float64)


def rotation_vector(turn: Array) -> Array:
    """Axis times angle (3,) [rad] of a rotation matrix (3, 3), accurate for small angles too."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = turn.tolist()
    twice_sine = np.array([zy - yz, xz - zx, yx - xy])
    sine = hypot(zy - yz, xz - zx, yx - xy) / 2
    cosine = (xx + yy + zz - 1) / 2
    if sine < SMALL_SINE and cosine > 0:  # sine and angle are equal here
        return np.asarray(twice_sine / 2, dtype=np.float64)
    if sine < SMALL_SINE:  # close to half a turn, where the matrix is nearly symmetric
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(turn).as_rotvec(), dtype=np.float64)
    scale = atan2(sine, cosine) / (2 * sine)
    return np.asarray(scale * twice_sine, dtype=np.float64)


def rotation(vector: Array) -> Array:
    """Rotation matrix (3, 3) of axis times angle (3,) [rad] (Rodrigues)."""
    x, y, z = vector.tolist()
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = hypot(x, y, z)
    if angle < 1e-9:
        return np.asarray(np.eye(3) + cross, dtype=np.float64)
    square = cross @ cross
    turned = np.eye(3) + sin(angle) / angle * cross + (1 - cos(angle)) / angle**2 * square
    return np.asarray(turned, dtype=np.float64)
