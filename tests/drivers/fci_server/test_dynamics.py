"""An emulated arm with mechanics of its own: what it feels, and where it stands."""

import numpy as np
import pytest

from drivers.fci_server.dynamics import Dynamics
from drivers.fci_server.posture import Posture, Rates
from drivers.franka.kinematics import FLANGE_TO_TIP, HOME
from drivers.franka.model import HAND_CENTRE, HAND_MASS, ArmPlant, holding_torques

Q = HOME + np.linspace(-0.2, 0.3, 7)


def at(q=Q, velocity=None, acceleration=None):
    still = np.zeros(7)
    rates = Rates(
        still if velocity is None else velocity, still if acceleration is None else acceleration
    )
    return Posture.at_joints(q, FLANGE_TO_TIP, rates)


def test_a_payload_weighs_and_resists_like_a_heavier_hand():
    payload, place = 0.4, np.array([0.01, 0.02, 0.1])
    both = (HAND_MASS * np.array(HAND_CENTRE) + payload * place) / (HAND_MASS + payload)
    expected = holding_torques(Q, HAND_MASS + payload, both)
    carrying = Dynamics(ArmPlant(payload=payload, payload_at=tuple(place)))
    assert carrying.torque(at()) == pytest.approx(expected, abs=1e-6)
    pushed = np.eye(7)[1]
    own, with_load = (
        Dynamics(p).torque(at(acceleration=pushed)) - Dynamics(p).torque(at())
        for p in (ArmPlant(), ArmPlant(payload=payload))
    )
    assert with_load[1] > own[1] > 0.1
