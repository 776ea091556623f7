"""An emulated arm with mechanics of its own: what it feels, and where it stands."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivers.arm import joint_log
from drivers.arm.joint_log import JointLog, joint_rows
from drivers.fci_server.dynamics import Dynamics, LaggingArm
from drivers.fci_server.posture import Course, Posture
from drivers.franka.kinematics import FLANGE_TO_TIP, HOME
from drivers.franka.model import HAND_CENTRE, HAND_MASS, ArmPlant, holding_torques

Q = HOME + np.linspace(-0.2, 0.3, 7)
SEVEN = (1.0,) * 7


def at(q=Q, velocity=None, acceleration=None):
    still = np.zeros(7)
    course = Course(
        still if velocity is None else velocity, still if acceleration is None else acceleration
    )
    return Posture.of(q, FLANGE_TO_TIP, course)


def test_at_rest_the_published_arm_feels_gravity_as_computed_otherwise():
    expected = holding_torques(Q, HAND_MASS, np.array(HAND_CENTRE))
    assert Dynamics(ArmPlant()).torque(at()) == pytest.approx(expected, abs=1e-6)


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


@pytest.mark.parametrize(
    ("plant", "added"),
    [
        ({"friction": SEVEN}, SEVEN),
        ({"damping": SEVEN}, (0.5,) * 7),
        ({"cable": SEVEN}, tuple(Q)),
    ],
)
def test_friction_damping_and_cables_add_their_torques(plant, added):
    moving = at(velocity=np.full(7, 0.5))
    more = Dynamics(ArmPlant(**plant)).torque(moving) - Dynamics(ArmPlant()).torque(moving)
    assert more == pytest.approx(np.array(added), abs=1e-6)


def test_a_tilt_about_both_axes_turns_gravity_and_keeps_its_size():
    plant = ArmPlant(tilt=(0.03, -0.01))
    assert np.linalg.norm(Dynamics(plant)._model.opt.gravity) == pytest.approx(9.81)
    reaching = at(HOME + np.eye(7)[1])
    assert abs(Dynamics(plant).torque(reaching)[0]) > 0.1  # the vertical joint carries weight now


def test_sensors_read_alike_at_one_tick_and_with_bias_and_scale():
    plant = ArmPlant(torque_bias=SEVEN, torque_scale=(0.1,) * 7, torque_noise=0.0)
    felt = Dynamics(ArmPlant()).torque(at())
    assert Dynamics(plant).reading(at(), 5) == pytest.approx(1.1 * felt + 1.0)
    noisy = Dynamics(ArmPlant(torque_noise=0.1))
    assert np.array_equal(noisy.reading(at(), 5), noisy.reading(at(), 5))
    assert not np.array_equal(noisy.reading(at(), 5), noisy.reading(at(), 6))


def test_links_stand_behind_their_motors_by_compliance_times_torque():
    dynamics = Dynamics(ArmPlant(compliance=(1e-4,) * 7))
    trailing = LaggingArm.of(at(), FLANGE_TO_TIP, 0.0, 0.0, dynamics.sag)
    sag = 1e-4 * Dynamics(ArmPlant()).torque(at())
    assert trailing.posture.q == pytest.approx(Q - sag, abs=1e-12)
    assert np.abs(sag).max() > 5e-4
    for k in range(200):
        trailing.tick(Q + 0.1 * (1 - np.cos(0.01 * k)))
    assert np.isfinite(trailing.posture.q).all()
    assert np.abs(trailing.posture.joints.acceleration).max() < 100.0


def test_a_log_keeps_the_newest_ticks_in_order(monkeypatch):
    monkeypatch.setattr(joint_log, "KEPT_TICKS", 4)
    log = JointLog()
    for k in range(6):
        parts = {name: [float(k)] * 7 for name in joint_log.JOINT_FIELDS}
        log.add(0.001 * k, SimpleNamespace(**parts))
    rows = joint_rows(log.content())
    assert rows[:, 0] == pytest.approx([0.002, 0.003, 0.004, 0.005])
    assert np.array_equal(rows[:, 28], [2.0, 3.0, 4.0, 5.0])
    assert joint_rows(JointLog().content()).shape == (0, joint_log.COLUMN_COUNT)
