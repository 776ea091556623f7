"""Inverse kinematics of the Franka Research 3: from any posture, tick by tick, and
rotations.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, cos, hypot, sin

import numpy as np

from drivers.base.errors import CellError
from drivers.base.types import Array, frozen
from drivers.franka.kinematics import (
    FLANGE_TO_TIP,
    HOME,
    PARAMETERS,
    WRIST_REACH,
    pose_and_jacobian,
)
from drivers.franka.limits import FR3, JointLimits

POSE_TOLERANCE = 1e-7  # m and rad
ITERATIONS = 150
LARGEST_STEP = 0.3  # rad, of one iteration
# share of the way to mid-range that an iteration takes where the pose allows
CENTRING_SHARE = 0.15
# 1/m and 1/rad: below an error of 0.1 the pull to mid-range fades out
CENTRING_GAIN = 10
# per m or rad of error; bounds
DAMPING_GAIN, LARGEST_DAMPING, LEAST_DAMPING = 0.1, 0.05, 1e-6
LINE_DAMPING = 0.02  # of the inverse along a straight line
HAND_REACH = 0.2  # m, more than the flange is away from the middle of the wrist
ELBOW_JOINT = 2  # its angle is the elbow's, as libfranka defines it
INVERSE_DAMPING = 1e-4
CONVERGED = 1e-6  # rad, a step of Newton's that ends tracking
SMALL_SINE = 1e-6  # of an angle, below which dividing by the sine loses precision
AT_END = 1e-6  # rad from a joint's limit, from which the joint counts as blocked by it
SHOULDER = frozen([0.0, 0.0, PARAMETERS[0, 1]])


class Unreachable(CellError):
    """Error for a pose that no posture within the joint limits reaches, for
    `reason`.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"pose out of reach: {reason}")
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Attempt:
    """Result of one search for joints: `joints` (7,) [rad], error `distance` [m],
    `angle` [rad].
    """

    joints: Array
    distance: float
    angle: float

    @property
    def converged(self) -> bool:
        """Whether errors of position and orientation are below POSE_TOLERANCE."""
        return max(self.distance, self.angle) < POSE_TOLERANCE


def solve(
    pose: Array,
    seed: Array = HOME,
    tool: Array = FLANGE_TO_TIP,
    limits: JointLimits = FR3,
) -> Array:
    """Joints (7,) [rad] within their limits that bring the tool to `pose` (4, 4) in the
    base.

    Searches from `seed` (7,) first, so that neighbouring poses get neighbouring
    postures, then from fixed other postures. Raises Unreachable. Damped least squares
    with nullspace: Siciliano et al., Robotics, 3.5 and 3.7.
    """
    if not np.isfinite(pose).all():
        raise Unreachable("it is not finite")
    best: Attempt | None = None
    for start in (seed, *_STARTS):
        attempt = _descend(pose, np.clip(start, *limits.ends), tool, limits)
        if attempt.converged:
            return attempt.joints
        if (
            best is None
            or attempt.distance + attempt.angle < best.distance + best.angle
        ):
            best = attempt
    raise Unreachable(_failure_reason(pose, tool, best, limits))


def twist_between(start: Array, end: Array) -> Array:
    """Displacement (6,) from pose `start` (4, 4) to `end` (4, 4) in the robot's base:
    translation [m], then rotation [rad].
    """
    turn = rotation_vector(end[:3, :3] @ start[:3, :3].T)
    return np.concatenate([end[:3, 3] - start[:3, 3], turn])


def joint_step(
    q: Array, reached: Array, jac: Array, target: Array, elbow: float
) -> Array:
    """Newton step (7,) [rad] of joints `q` (7,) to tool pose `target` (4, 4) and angle
    `elbow`.

    `reached` (4, 4) and `jac` (6, 7) are those of `q` by `pose_and_jacobian`. Exact up
    to the square of the distance, so that the error after one tick is corrected in the
    next. Damped, and so bounded, in singular postures.
    """
    twist = np.append(twist_between(reached, target), elbow - q[ELBOW_JOINT])
    return joint_rates(jac, twist)


def track(
    q: Array, pose: Array, elbow: float, iterations: int, tolerance: float = CONVERGED
) -> tuple[Array, Array] | None:
    """Joints (7,) [rad] near `q` (7,) with the tool at `pose` (4, 4), and the Jacobian
    (6, 7).

    The elbow's angle, joint 3, is `elbow` [rad]. None where the last of at most
    `iterations` Newton steps is not below `tolerance` [rad].
    """
    for _ in range(iterations):
        reached, jac = pose_and_jacobian(q)
        step = joint_step(q, reached, jac, target=pose, elbow=elbow)
        q = q + step
        size = float(np.abs(step).max())
        if size < CONVERGED:
            break
    return (q, jac) if size < tolerance else None


def joint_rates(jac: Array, twist: Array) -> Array:
    """Joint rates (7,) [rad/s] for `twist` (7,): of the tool (6), then of the elbow;
    `jac` (6, 7) is the tool's Jacobian.
    """
    with_elbow = np.zeros((7, 7))
    with_elbow[:6] = jac
    with_elbow[6, ELBOW_JOINT] = 1
    square = with_elbow @ with_elbow.T
    square.flat[::8] += INVERSE_DAMPING**2
    return with_elbow.T @ np.linalg.solve(square, twist)


def rotation_vector(turn: Array) -> Array:
    """Rotation vector (3,) [rad], axis times angle, of a rotation matrix `turn` (3,
    3).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = turn.tolist()
    twice_sine = np.array([zy - yz, xz - zx, yx - xy])
    sine = hypot(zy - yz, xz - zx, yx - xy) / 2
    cosine = (xx + yy + zz - 1) / 2
    if sine < SMALL_SINE and cosine > 0:  # sine and angle are equal here
        return twice_sine / 2
    if sine < SMALL_SINE:  # close to half a turn, where the matrix is nearly symmetric
        from scipy.spatial.transform import Rotation

        vector: Array = Rotation.from_matrix(turn).as_rotvec()
        return vector
    scale = atan2(sine, cosine) / (2 * sine)
    return scale * twice_sine


def rotation(vector: Array) -> Array:
    """Rotation matrix (3, 3) of a rotation `vector` (3,) [rad], axis times angle
    (Rodrigues).
    """
    x, y, z = vector.tolist()
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = hypot(x, y, z)
    turned: Array = np.eye(3) + cross
    if angle >= 1e-9:
        square = cross @ cross
        turned = (
            np.eye(3)
            + sin(angle) / angle * cross
            + (1 - cos(angle)) / angle**2 * square
        )
    return turned


def _damped_inverse(jac: Array, damping: float) -> Array:
    """Damped pseudo-inverse (7, 6) of a Jacobian (6, 7), bounded near singular
    postures.
    """
    square = jac @ jac.T
    square[np.diag_indices(6)] += damping**2
    return np.asarray(np.linalg.solve(square, jac).T, dtype=np.float64)


def straight(joints: Array, step: Array) -> Iterator[Array]:
    """Yield the arm's joints (7,) [rad] endlessly, each moving the tip straight on by a
    `step` (3,) [m]; limits are not checked.
    """
    twist = np.concatenate([step, np.zeros(3)])
    while True:
        joints = (
            joints + _damped_inverse(pose_and_jacobian(joints)[1], LINE_DAMPING) @ twist
        )
        yield joints


def manipulability(jac: Array) -> float:
    """Smallest singular value of a Jacobian (6, 7): 0 in a singular posture."""
    return float(np.linalg.svd(jac, compute_uv=False)[-1])


def _descend(pose: Array, start: Array, tool: Array, limits: JointLimits) -> Attempt:
    """Search for joints that bring the tool to `pose`, from `start` (7,) [rad] by
    damped least squares, drawn to mid-range.
    """
    joints = np.array(start, dtype=np.float64)
    for _ in range(ITERATIONS):
        reached, jac = pose_and_jacobian(joints, tool)
        error = twist_between(reached, pose)
        size = float(np.abs(error).max())
        if size < POSE_TOLERANCE / 2:
            break

        centring = (
            CENTRING_SHARE * (limits.middle - joints) * min(1.0, CENTRING_GAIN * size)
        )
        step = _step(jac, error, centring, size)
        blocked = np.clip(joints + step, *limits.ends) != joints + step
        if blocked.any():  # the other joints compensate for those at their limits
            step = _step(jac * ~blocked, error, centring * ~blocked, size)

        step *= min(1.0, LARGEST_STEP / max(float(np.abs(step).max()), LARGEST_STEP))
        joints = np.clip(joints + step, *limits.ends)
    error = twist_between(pose_and_jacobian(joints, tool)[0], pose)
    return Attempt(
        joints, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    )


def _step(jac: Array, error: Array, posture: Array, size: float) -> Array:
    """Joint step (7,) [rad] that reduces the pose `error` (6,), and moves towards
    `posture` (7,) in the null space.
    """
    inverse = _damped_inverse(
        jac, min(DAMPING_GAIN * size, LARGEST_DAMPING) + LEAST_DAMPING
    )
    step: Array = inverse @ error + posture - inverse @ (jac @ posture)
    return step


def _failure_reason(
    pose: Array, tool: Array, best: Attempt | None, limits: JointLimits
) -> str:
    """Reason, for the operator, why no search reached `pose` (4, 4); `best` came
    nearest.
    """
    if best is None:
        return "no posture was tried"

    flange = pose @ np.linalg.inv(tool)
    distance = float(np.linalg.norm(flange[:3, 3] - SHOULDER))
    if distance > WRIST_REACH + HAND_REACH:
        return (
            f"the flange would be {distance:.2f} m from the shoulder; the arm ends"
            " before"
        )

    room = limits.margins(best.joints)
    ended = [f"joint {joint + 1}" for joint in range(7) if room[joint] < AT_END]
    missed = (
        f"{1e3 * best.distance:.1f} mm and {np.degrees(best.angle):.1f} deg are missing"
    )
    return f"{missed}" + (f" with {' and '.join(ended)} at the end" if ended else "")


def _start_postures() -> tuple[Array, ...]:
    """Joints (7,) [rad] from which a search begins anew: spread over the arm's
    postures.
    """
    folded = frozen([0.0, 0.3, 0.0, -2.2, 0.0, 2.5, 0.8])
    sideways = [frozen(HOME + frozen([yaw, 0, 0, 0, 0, 0, 0])) for yaw in (-1.2, 1.2)]
    return (HOME, FR3.middle, folded, *sideways)


_STARTS = _start_postures()
