"""Measured motion: filtered as its torques are, and as sure as its encoders are."""

import numpy as np
import pytest
import yaml

from cell.gap.subject.mechanism.effects import effect_of, ordered_values
from cell.gap.subject.mechanism.open_mechanism import open_mechanism
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.subject import Request
from tests.lab.exam import mechanisms as synthetic
from tests.support.mechanisms import left, write_run

CUTOFF, WIDTH = 60.0, 0.06
HIDDEN = (
    "nothing", "dry_friction", "quadratic_damping", "cable_spring", "armature", "payload",
    "torque_constant", "torque_bias", "encoder_bias", "control_delay", "joint_elasticity",
)  # fmt: skip


@pytest.mark.parametrize("hidden", HIDDEN)
def test_hidden_effect_of_a_mechanism_has_the_librarys_values(tmp_path, monkeypatch, hidden):
    monkeypatch.setattr(synthetic, "RUNS", 2)
    monkeypatch.setattr(synthetic, "SPAN", 2.0)
    file = synthetic.make_runs(tmp_path, hidden, 2, 1.0, 3)
    mechanism = open_mechanism(file, find_runs([tmp_path / "runs"]))
    truth = synthetic.amounts(hidden, 2, 1.0)
    values = ordered_values(effect_of(hidden), mechanism.opened.mechanism, truth) if truth else None
    assert left(mechanism, **({hidden: values} if truth else {})) < 1.2
    if truth:
        assert left(mechanism) > 1.5


STANDING = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody><body name="b">
<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><joint name="j" axis="0 1 0"/></body>
</worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


@pytest.fixture
def standing(tmp_path) -> MechanismSubject:
    """A joint with friction of 0.5 N m that turns, stops, and stands under 0.3, 0 and 0.7 N m."""
    t = np.arange(0.0, 9.0, 0.004)
    phase = np.clip(t / 3.0, 0.0, 1.0)
    q = 1.5 * phase**4 * (35 - 84 * phase + 70 * phase**2 - 20 * phase**3)
    v, a = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    moving = 0.1 * a + 0.5 * np.tanh(v / 0.01)
    given = np.select([t < 3.0, t < 5.0, t < 7.0], [moving, 0.3, 0.0], 0.7)
    for k in range(2):
        head = {"mechanism": "one", "index": k}
        write_run(tmp_path / "runs" / f"{k}", {"t": t, "j": q, "tau": given}, head)
    (tmp_path / "one.xml").write_text(STANDING)
    content = {"schema": 1, "kind": "mechanism", "name": "one", "model": "one.xml",
               "mode": "prescribed", "inputs": {"j": "position"},
               "signals": {"tau": {"actuator": "m", "is": "torque", "sigma": 0.01}},
               "uncertain": [{"actuator": "m", "field": "gain", "spread": "5%"}]}  # fmt: skip
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(content))
    return open_mechanism(tmp_path / "one.yaml", find_runs([tmp_path / "runs"]))


def test_friction_holds_a_joint_that_stands_up_to_its_limit(standing):
    run = standing.runs[0]
    (found,) = standing.simulate([Request(run, np.ones(1), {"dry_friction": np.array([0.5, 0.0])},
                                          np.zeros(0))])  # fmt: skip
    t = run.samples.t
    assert np.abs(found.mean[(t > 3.5) & (t < 6.5)]).max() < 0.01
    assert found.mean[t > 7.5] == pytest.approx(0.2, abs=0.01)
    assert np.abs(found.mean[(t > 1.0) & (t < 2.0)]).max() < 0.02


def test_an_error_of_a_number_that_is_stated_as_uncertain_is_no_effect(standing):
    names = {c.name for c in standing.scope.candidates}
    assert "torque_constant" not in names
    assert {"armature", "com_error"} <= names
