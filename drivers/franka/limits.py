"""Public limits of the Franka Research 3: joints, Cartesian motion, elbow.

Sources: franka_description (fr3/joint_limits.yaml) for joints and torques, the user
documentation "Robot and interface specifications" and libfranka's rate_limiting.h for
rates. Never measured on a robot.
"""

import numpy as np

from drivers.base.types import Array, frozen

# rad
POSITION_LOW = frozen([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159])
POSITION_HIGH = frozen([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159])  # rad
MIDDLE = frozen((POSITION_LOW + POSITION_HIGH) / 2)  # rad
VELOCITY = frozen([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])  # rad/s
ACCELERATION = frozen([10.0] * 7)  # rad/s^2
JERK = frozen([5000.0] * 7)  # rad/s^3
LARGEST_TORQUE = frozen([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])  # N m

# Close to a joint's end its velocity is limited so that it can still brake.
VELOCITY_OFFSET = frozen([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])  # rad/s
DECELERATION = frozen([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])  # rad/s^2

TRANSLATION = (3.0, 9.0, 4500.0)  # m/s, m/s^2, m/s^3
ROTATION = (2.5, 17.0, 8500.0)  # rad/s, rad/s^2, rad/s^3
ELBOW = (1.5, 10.0, 5000.0)  # rad/s, rad/s^2, rad/s^3


def margins(q: Array) -> Array:
    """Distance (..., 7) [rad] of joints `q` (..., 7) from their nearer limit; negative
    beyond.

    User documentation, "limits depending on the joint position".
    """
    return np.minimum(q - POSITION_LOW, POSITION_HIGH - q)


def velocity_bounds(q: Array) -> tuple[Array, Array]:
    """Lowest and highest joint velocity (..., 7) [rad/s] allowed at joints `q` (..., 7)
    [rad].

    User documentation, "limits depending on the joint position".
    """
    return -_braking_speed(q - POSITION_LOW), _braking_speed(POSITION_HIGH - q)


def _braking_speed(room: Array) -> Array:
    """Speed (..., 7) [rad/s] from which a joint can brake within `room` (..., 7)
    [rad].
    """
    speed = np.sqrt(2 * DECELERATION * np.maximum(room, 0)) - VELOCITY_OFFSET
    bounded: Array = np.minimum(np.maximum(speed, 0), VELOCITY)
    return bounded
