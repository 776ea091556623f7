"""One tick of the emulated robot's motion generators against the kinematics of `drivers.franka`."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.fci_server.generators import follow
from drivers.fci_server.limits import Violation
from drivers.fci_server.posture import Course, Posture, twist_of
from drivers.fci_server.wire import Generator, Reflex, RobotCommand
from drivers.franka.kinematics import FLANGE_TO_TIP, HOME, pose_and_jacobian
from drivers.franka.tracking import joint_step, rotation
from drivers.motion import TICK
from drivers.types import Array

POSE, VELOCITY = Generator.CARTESIAN_POSE, Generator.CARTESIAN_VELOCITY


def command(pose: Array, twist: Array, angle: tuple[float, float] | None = None) -> RobotCommand:
    return RobotCommand(0, np.zeros(7), np.zeros(7), pose, twist, angle, finished=False)


def postures(count: int = 40) -> list[Posture]:
    rng = np.random.default_rng(5)
    return [Posture.resting(HOME + rng.uniform(-0.4, 0.4, 7), FLANGE_TO_TIP) for _ in range(count)]


def small_twists(count: int = 40) -> list[Array]:
    """Within the jerk that a robot at rest allows."""
    rng = np.random.default_rng(6)
    return [2e-4 * rng.uniform(-1.0, 1.0, 6) for _ in range(count)]


@pytest.mark.parametrize("generator", [POSE, VELOCITY])
def test_one_tick_is_one_step_of_differential_inverse_kinematics(generator: Generator) -> None:
    for old, twist in zip(postures(), small_twists(), strict=True):
        pose = np.array(old.pose)
        pose[:3, 3] += TICK * twist[:3]
        pose[:3, :3] = rotation(TICK * twist[3:]) @ old.pose[:3, :3]
        new = follow(generator, old, command(pose, twist), FLANGE_TO_TIP, first=True)
        step = joint_step(old.q, old.reached, old.jacobian, pose, old.elbow)
        np.testing.assert_allclose(new.q, old.q + step, atol=1e-12)
        np.testing.assert_allclose(new.joints.velocity, step / TICK, atol=1e-9)
        np.testing.assert_allclose(new.pose, pose, atol=1e-13)
        np.testing.assert_allclose(new.reached, pose_and_jacobian(new.q)[0], atol=1e-14)
        np.testing.assert_allclose(new.tool.velocity, twist_of(old.pose, pose), atol=1e-11)
        np.testing.assert_allclose(new.tool.acceleration, twist / TICK, atol=1e-8)


def broken(old: Posture, generator: Generator, pose: Array, twist: Array) -> Reflex:
    with pytest.raises(Violation) as caught:
        follow(generator, old, command(pose, twist), FLANGE_TO_TIP, first=False)
    return caught.value.reflex


def test_a_joint_too_fast_to_brake_before_its_end_is_refused() -> None:
    q = np.array(HOME)
    q[5] = 4.5169 - 0.002
    rolling = Posture.of(q, FLANGE_TO_TIP, Course(0.3 * np.eye(7)[5], np.zeros(7)))
    twist = rolling.jacobian @ rolling.joints.velocity
    moving = replace(rolling, tool=Course(twist, np.zeros(6)))
    reflex = broken(moving, VELOCITY, moving.pose, twist)
    assert reflex is Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_LIMITS_VIOLATION
