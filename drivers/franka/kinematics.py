"""Forward kinematics and Jacobian of the Franka Research 3, in its base frame."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.base.readers import read_yaml
from drivers.base.types import Array, frozen

PUBLISHED = read_yaml(Path(__file__).with_name("published.yaml"))
"""Numbers of the arm from its maker and from papers, each with its source."""
# Denavit-Hartenberg parameters after Craig, one row a joint: a [m], d [m], alpha [rad]
PARAMETERS = frozen(np.array(PUBLISHED["kinematics"]) * [1.0, 1.0, np.pi / 2])
FLANGE = 0.107  # m, from the last joint along its axis
WRIST_REACH = 0.855  # m, about the shoulder, to the middle of the wrist
# rad of joint 4, beyond which the elbow is flexed the other way
ELBOW_FLIP = -0.467002423653011
HOME = frozen([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])  # rad

_HALF = np.sqrt(0.5)
FLANGE_TO_HAND = frozen(
    [[_HALF, _HALF, 0, 0], [-_HALF, _HALF, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
)
HAND_TO_TIP = frozen([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.1034], [0, 0, 0, 1]])
# the robot's F_T_EE with the Franka Hand
FLANGE_TO_TIP = frozen(FLANGE_TO_HAND @ HAND_TO_TIP)

_COS_ALPHA, _SIN_ALPHA = np.cos(PARAMETERS[:, 2]), np.sin(PARAMETERS[:, 2])


def _fixed_parts() -> tuple[Array, Array, Array]:
    """Matrices A, B, C (7, 4, 4) [m] of the joint transforms, which at joint angle q
    are cos(q) A + sin(q) B + C.
    """
    cosine, sine, fixed = np.zeros((3, 7, 4, 4))
    cosine[:, 0, 0] = 1
    cosine[:, 1, 1] = _COS_ALPHA
    cosine[:, 2, 1] = _SIN_ALPHA
    sine[:, 0, 1] = -1
    sine[:, 1, 0] = _COS_ALPHA
    sine[:, 2, 0] = _SIN_ALPHA
    fixed[:, 0, 3] = PARAMETERS[:, 0]
    fixed[:, 1, 2] = -_SIN_ALPHA
    fixed[:, 2, 2] = _COS_ALPHA
    fixed[:, 1, 3] = -_SIN_ALPHA * PARAMETERS[:, 1]
    fixed[:, 2, 3] = _COS_ALPHA * PARAMETERS[:, 1]
    fixed[:, 3, 3] = 1
    return frozen(cosine), frozen(sine), frozen(fixed)


_COSINE, _SINE, _FIXED = _fixed_parts()


def offset_in_frame(joint: int) -> tuple[float, float]:
    """Denavit-Hartenberg offset d of joint number `joint` (from 0) as (y, z) [m] in the
    frame before this joint.
    """
    _, d, alpha = PARAMETERS[joint].tolist()
    if alpha == 0:
        return 0.0, d
    return (d, 0.0) if alpha < 0 else (-d, 0.0)


def frames(q: Array) -> Array:
    """Poses (..., 7, 4, 4) of the seven joints' frames in the base for joints (..., 7)
    [rad].
    """
    angles = np.asarray(q, dtype=np.float64)[..., None, None]
    links: Array = np.cos(angles) * _COSINE + np.sin(angles) * _SINE + _FIXED
    for joint in range(1, 7):
        links[..., joint, :, :] = links[..., joint - 1, :, :] @ links[..., joint, :, :]
    return links


def forward(q: Array, tool: Array = FLANGE_TO_TIP) -> Array:
    """Pose (..., 4, 4) of the tool in the robot's base for joints `q` (..., 7) [rad].

    `tool` (4, 4) is the tool in the flange's frame; by default the tip of the Franka
    Hand.
    """
    return frames(q)[..., 6, :, :] @ _from_last_joint(tool)


def pose_and_jacobian(q: Array, tool: Array = FLANGE_TO_TIP) -> tuple[Array, Array]:
    """Tool pose (..., 4, 4), Jacobian (..., 6, 7) [m/rad, then 1] in the base at `q`
    (..., 7).
    """
    joints = frames(q)
    pose = joints[..., 6, :, :] @ _from_last_joint(tool)
    axis = joints[..., :3, 2]
    lever = pose[..., None, :3, 3] - joints[..., :3, 3]
    columns = np.empty((*axis.shape[:-1], 6))  # axis x lever, faster than np.cross
    columns[..., 0] = axis[..., 1] * lever[..., 2] - axis[..., 2] * lever[..., 1]
    columns[..., 1] = axis[..., 2] * lever[..., 0] - axis[..., 0] * lever[..., 2]
    columns[..., 2] = axis[..., 0] * lever[..., 1] - axis[..., 1] * lever[..., 0]
    columns[..., 3:] = axis
    return pose, np.swapaxes(columns, -1, -2)


def _from_last_joint(tool: Array) -> Array:
    """Pose (4, 4) [m] in the last joint's frame of a `tool` (4, 4) given in the
    flange's frame.
    """
    pose = np.array(tool, dtype=np.float64)
    pose[2, 3] += FLANGE
    return pose


def pose_from_columns(columns: Sequence[float]) -> Array:
    """Pose (4, 4) from its 16 numbers in column-major order, as the robot's state holds
    it.
    """
    return np.array(columns, dtype=np.float64).reshape(4, 4).T
