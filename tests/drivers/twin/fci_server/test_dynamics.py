"""An emulated arm with mechanics of its own: what it feels, and where it stands."""

import numpy as np
import pytest

from drivers.base.types import GRAVITY
from drivers.franka.kinematics import FLANGE, FLANGE_TO_TIP, HOME, frames
from drivers.franka.model import (
    CENTRES,
    HAND_CENTRE,
    HAND_MASS,
    MASSES,
    ArmModel,
    ArmPlant,
)
from drivers.twin.fci_server.dynamics import Dynamics, LaggingArm
from drivers.twin.fci_server.posture import Posture, Rates

Q = HOME + np.linspace(-0.2, 0.3, 7)
STILL = np.zeros(7)


def at(acceleration=STILL):
    return Posture.at_joints(Q, FLANGE_TO_TIP, Rates(STILL, acceleration))


def height(q):
    """Potential energy [J] of links and hand."""
    joints = frames(q)
    places = [f[:3, :3] @ c + f[:3, 3] for f, c in zip(joints, CENTRES, strict=True)]
    hand = joints[6] @ [*np.add(HAND_CENTRE, (0, 0, FLANGE)), 1.0]
    return GRAVITY * (MASSES @ np.array(places)[:, 2] + HAND_MASS * hand[2])


def test_torques_at_rest_hold_the_masses_that_are_published():
    steps = 1e-6 * np.eye(7)
    slopes = [(height(Q + step) - height(Q - step)) / 2e-6 for step in steps]
    assert ArmModel().torques(Q) == pytest.approx(slopes, abs=1e-4)


def test_a_payload_weighs_and_resists_like_a_heavier_hand():
    payload, place = 0.4, np.array([0.01, 0.02, 0.1])
    both = (HAND_MASS * np.array(HAND_CENTRE) + payload * place) / (HAND_MASS + payload)
    expected = ArmModel(HAND_MASS + payload, tuple(both)).torques(Q)
    carrying = Dynamics(ArmPlant(payload=payload, payload_at=tuple(place)))
    assert carrying.torque(at()) == pytest.approx(expected, abs=1e-6)
    pushed = np.eye(7)[1]
    own, with_load = (
        Dynamics(p).torque(at(acceleration=pushed)) - Dynamics(p).torque(at())
        for p in (ArmPlant(), ArmPlant(payload=payload))
    )
    assert with_load[1] > own[1] > 0.1


@pytest.mark.parametrize("compliance", [0.0, 8e-5])
def test_an_arm_that_has_come_to_rest_reports_no_acceleration(compliance):
    sag = Dynamics(ArmPlant(compliance=(compliance,) * 7)).sag if compliance else None
    arm = LaggingArm(at(), FLANGE_TO_TIP, 0.002, 0.0, sag)
    for moved in [1e-5, 2e-5, *[2e-5] * 20]:
        arm.tick(Q + moved)
    assert not np.any([arm.posture.joints.velocity, arm.posture.joints.acceleration])
