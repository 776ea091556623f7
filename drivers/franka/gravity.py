"""Joint torques that hold the Franka Research 3 and its load against gravity."""

import numpy as np

from drivers.franka.kinematics import FLANGE, frames
from drivers.types import Array, frozen

GRAVITY = 9.81  # m/s^2

# Masses [kg] and centres of mass [m] of links 1 to 7 in their joints' frames. Source: Gaz et al.,
# Dynamic identification of the Franka Emika Panda robot with retrieval of feasible parameters,
# RA-L 4(4), 2019. Of a Panda; those of a Research 3 differ a little.
MASSES = frozen([4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522])
CENTRES = frozen(
    [
        [0.003875, 0.002081, -0.04762],
        [-0.003141, -0.02872, 0.003495],
        [0.027518, 0.039252, -0.066502],
        [-0.05317, 0.104419, 0.027454],
        [-0.011953, 0.041065, -0.038437],
        [0.060149, -0.014117, -0.010517],
        [0.010517, -0.004252, 0.061597],
    ]
)


def holding_torques(q: Array, mass: float, centre: Array) -> Array:
    """Joint torques (7,) [N m] that hold the arm still in joints (7,) [rad].

    `mass` [kg] with its `centre` (3,) [m] in the flange's frame is hand and load together.
    """
    joints = frames(q)
    at_joint = np.array(centre, dtype=np.float64)
    at_joint[2] += FLANGE
    places = np.einsum("jik,jk->ji", joints[:, :3, :3], CENTRES) + joints[:, :3, 3]
    held = joints[6, :3, :3] @ at_joint + joints[6, :3, 3]
    points, weights = np.vstack([places, held]), np.append(MASSES, mass) * GRAVITY
    torques = np.zeros(7)
    for joint in range(7):
        origin, axis = joints[joint, :3, 3], joints[joint, :3, 2]
        beyond = slice(joint, 8)  # links from the joint on, and the load
        moment = np.cross(points[beyond] - origin, np.outer(weights[beyond], [0.0, 0.0, 1.0]))
        torques[joint] = float(axis @ moment.sum(axis=0))
    return torques
