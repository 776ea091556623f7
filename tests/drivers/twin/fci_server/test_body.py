"""What the emulated arm weighs, meets and trails behind."""

import numpy as np
import pytest

from drivers.base.types import frozen
from drivers.franka.collision import BoxObstacle, Solids, self_clearance
from drivers.franka.kinematics import HOME
from drivers.franka.model import ArmModel
from drivers.twin.fci_server.limits import BodyCheck, Violation
from drivers.twin.fci_server.robot import resting_robot
from drivers.twin.fci_server.state import Publisher
from drivers.twin.fci_server.wire import Reflex

FLOOR = Solids(frozen(np.eye(4)), (BoxObstacle("floor", (-5, -5, -5), (5, 5, 0.0)),))
HAND = (-0.01, 0.0, 0.03)
# the wrist in the shoulder
FOLDED = frozen([1.06, -1.42, -2.7, -2.49, 2.44, 3.79, 2.07])


def test_state_holds_gravity_of_arm_hand_and_load() -> None:
    robot, publisher = resting_robot(), Publisher()
    publisher.datagram(robot)
    torques = publisher.fields["tau_J"]
    assert torques == pytest.approx(ArmModel(0.73, HAND).torques(HOME), abs=1e-4)
    assert np.abs(torques).max() > 10.0


def test_an_arm_folded_onto_itself_touches_itself() -> None:
    assert self_clearance(np.stack([HOME, FOLDED])) == pytest.approx(
        [float(self_clearance(HOME)), float(self_clearance(FOLDED))]
    )
    assert self_clearance(HOME) > 0.1
    assert self_clearance(FOLDED) < 0
    with pytest.raises(Violation) as met:
        BodyCheck().check(FOLDED)
    assert met.value.reflex is Reflex.SELF_COLLISION_AVOIDANCE_VIOLATION


def lowered(depth: float) -> np.ndarray:
    """Joints from HOME on with the shoulder bent forward until the hand is down by
    `depth` rad.
    """
    return HOME + np.array([0, depth, 0, 0, 0, 0, 0])


def test_floor_stops_the_arm_once_and_lets_it_leave() -> None:
    heights = [
        float(FLOOR.clearance(lowered(d)).min()) for d in np.linspace(0, 1.5, 16)
    ]
    assert heights[0] > 0.2
    assert min(heights) < 0.0
    check, low = BodyCheck(FLOOR), int(np.argmax(np.array(heights) < 0))
    check.check(lowered(0.0))
    with pytest.raises(Violation) as met:
        check.check(lowered(0.1 * low))
    assert met.value.reflex is Reflex.CARTESIAN_REFLEX
    check.check(lowered(0.1 * low - 0.001))
    with pytest.raises(Violation):
        check.check(lowered(0.1 * low + 0.05))
