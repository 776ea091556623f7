"""A guarded way out of contact: a little along the force, until the arm is free."""

from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np

from drivers.arm.failure import Cause, Failed, Failure
from drivers.arm.force import ForceGuard
from drivers.arm.settings import CollisionSettings, FciSettings
from drivers.arm.way import follow_joints
from drivers.franka import limits
from drivers.franka.inverse import straight
from drivers.types import Array

AWAY = 0.03  # m at most
PLACE_STEP = 0.001  # m between the places that are solved
FORCE_RISE = 8.0  # N by which the force may rise meanwhile
SPEED_SHARE = 0.05  # share of the joints' speed
FREE = 0.3  # share of the allowed force at rest from which the arm counts as free
JOINT_MARGIN = 0.03  # rad that each joint keeps from its ends


def retreat(robot: Any, settings: FciSettings, left: Callable[[], bool]) -> None:
    """Bring a `robot` at rest out of what presses on its gripper; does nothing where nothing
    presses.

    The reflexes are loosened for it, as they would stop it at once, and set again by the caller.
    Raises Failed where the force rises on the way, or does not leave the arm within AWAY.
    """
    state = robot.state()
    force = np.array(state.O_F_ext_hat_K[:3])
    size = float(np.linalg.norm(force))
    if size <= settings.rest:
        return
    goal = _beside(np.array(state.q), force / size)
    robot.configure(_loosen(settings.collision, size))
    guard = ForceGuard(size + FORCE_RISE)

    def free(now: Any) -> bool:
        return float(np.linalg.norm(now.O_F_ext_hat_K[:3])) < FREE * settings.rest

    follow_joints(robot, goal.tolist(), SPEED_SHARE, guard, left, free)
    after = float(np.linalg.norm(robot.state().O_F_ext_hat_K[:3]))
    if after > settings.rest:
        words = (
            f"the gripper still feels {after:.1f} N after a retreat of {1e3 * AWAY:.0f} mm from "
            f"{size:.1f} N, allowed {settings.rest:.1f} N"
        )
        raise Failed(Failure(Cause.PRESSED, words))


def _beside(joints: Array, direction: Array) -> Array:
    """Joints (7,) [rad] that move the tip by AWAY along `direction` (3,) without turning it."""
    *_, joints = islice(straight(joints, PLACE_STEP * direction), round(AWAY / PLACE_STEP))
    if limits.margins(joints).min() < JOINT_MARGIN:
        words = "no way leads out of the contact: a joint is at its end; free the arm by hand"
        raise Failed(Failure(Cause.PRESSED, words))
    return joints


def _loosen(collision: CollisionSettings, force: float) -> CollisionSettings:
    """Thresholds under which the arm may move while it is pressed with `force` [N]."""
    upper = {
        "force_upper": min(max(collision.force_upper, 2 * force + FORCE_RISE), 100.0),
        "moment_upper": min(2 * collision.moment_upper, 100.0),
        "torque_upper": min(2 * collision.torque_upper, 87.0),
    }
    return collision.model_copy(update=upper)
