"""The cell's own arm as a mechanism: its file, its records, what is accepted into
cell.yaml.
"""

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy.special import betainc

from cell.base.config.places import CHECKOUT_CONFIGS, find_configs
from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism import cell_arm
from cell.gap.subject.run_folders import RunFolder
from cell.gap.verdict.accept import accept
from cell.record.tables import joint_table, write_parquet
from drivers.franka.kinematics import FLANGE_TO_TIP, HOME
from drivers.franka.model import ArmPlant, arm_mjcf
from drivers.twin.fci_server.dynamics import Dynamics, LaggingArm
from drivers.twin.fci_server.posture import Posture, zero_rates
from tests.support.fit_folders import write_mechanism_fit
from tests.support.refusals import refusal

FILE = CHECKOUT_CONFIGS / "mechanisms" / "arm" / "mechanism.yaml"
TICKS = 1500
SOFT = 8e-5


def record(folder: Path, plant: ArmPlant, phase: float) -> RunFolder:
    """A run of an arm that swings all its joints, as a fold keeps it."""
    dynamics = Dynamics(plant)
    sag = dynamics.sag if any(plant.compliance) else None
    t = 1e-3 * np.arange(TICKS)
    swing = 0.25 * np.sin(np.outer(t, np.linspace(1.5, 4.0, 7)) + phase)
    commanded = HOME + swing * betainc(3, 3, np.minimum(2.0 * t, 1.0))[:, None]
    begun = Posture.at_joints(commanded[0], FLANGE_TO_TIP, zero_rates(7))
    arm = LaggingArm(begun, FLANGE_TO_TIP, plant.delay, 0.0, sag)
    rows = []
    for k, q_d in enumerate(commanded):
        arm.tick(q_d)
        here = arm.posture
        torque = dynamics.reading(here, k)
        rows.append([t[k], *here.q, *here.joints.velocity, *q_d, *torque])
    folder.mkdir(parents=True)
    write_parquet(folder / "joints.parquet", joint_table(np.array(rows), 0.0))
    head = {"schema": 1, "strip": "denim", "index": int(10 * phase)}
    (folder / "run.yaml").write_text(yaml.safe_dump(head))
    return RunFolder(folder, folder.name)


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    """Two runs of an arm that carries a load, twists and lags, as the subject opens
    them.
    """
    folder = tmp_path_factory.mktemp("soft")
    plant = ArmPlant(payload=0.3, compliance=(SOFT,) * 7, delay=0.006, torque_noise=0.0)
    return open_mechanism(
        FILE, [record(folder / f"{k}", plant, 0.1 * k) for k in range(2)]
    )


def test_the_model_of_the_arm_is_the_published_one():
    whole = ET.fromstring(arm_mjcf())  # noqa: S314  our own text
    ET.indent(whole)
    text = ET.tostring(whole, encoding="unicode") + "\n"
    assert (FILE.parent / "model.xml").read_text() == text
    assert find_configs(None).mechanism_path("arm").samefile(FILE)


def left(subject, effects) -> dict[str, float]:
    """Rms of what torques [N m] and tracking [rad] leave, by kind."""
    found = subject.simulate([subject.stated(run, effects) for run in subject.runs])
    squares = np.concatenate([residuals.mean**2 for residuals in found])
    channel = np.concatenate([run.samples.channel for run in subject.runs]).astype(str)
    return {
        kind: np.sqrt(squares[np.char.startswith(channel, kind)].mean())
        for kind in ("torque", "tracking")
    }


@pytest.mark.slow
def test_what_was_hidden_explains_torques_and_tracking(soft):
    hidden = {
        "payload": np.array([0.3]),
        "control_delay": np.array([0.006]),
        "joint_elasticity": np.full(7, SOFT),
    }
    none, whole = left(soft, {}), left(soft, hidden)
    assert none["torque"] > 0.5
    assert whole["torque"] < 0.1 * none["torque"]  # the rest is what smoothing takes
    assert none["tracking"] > 1e-3
    assert whole["tracking"] < 1e-4
    for name in ("joint_elasticity", "control_delay"):
        without = {k: v for k, v in hidden.items() if k != name}
        assert left(soft, without)["tracking"] > 5 * whole["tracking"]


@pytest.mark.slow
def test_load_and_delay_are_accepted_into_the_cell(soft, tmp_path):
    file = shutil.copytree(FILE.parent, tmp_path / "arm") / FILE.name
    cell, out = tmp_path / "cell.yaml", tmp_path / "out"
    shutil.copy(CHECKOUT_CONFIGS / cell.name, cell)
    base = {p.name: p.start for p in soft.scope.base}
    effects = {"payload": {"mass": 0.3}, "control_delay": {"time": 0.006}}
    write_mechanism_fit(out, file, soft, base, effects)
    before = yaml.safe_load(cell.read_text())
    accept(out, file, cell)
    found = yaml.safe_load(cell.read_text())
    twin, tool = found["twin"], found["fci"]["tool"]
    assert twin["arm"]["robot_delay"] == 0.006
    assert tool["mass"] == pytest.approx(1.03)
    centre = (0.73 * 0.03 + 0.3 * 0.1034) / 1.03
    assert tool["centre"][2] == pytest.approx(centre, abs=1e-5)
    assert twin["world"] == before["twin"]["world"]
    accepted = yaml.safe_load(file.read_text())["effects"]
    assert accepted["control_delay"] == effects["control_delay"]


def test_the_farthest_that_an_effect_moves_the_gripper_is_told(monkeypatch):
    monkeypatch.setattr(cell_arm, "ordered_values", lambda *_: np.zeros(1))
    moved = np.array([1e-3, 4e-3])
    arm = SimpleNamespace(mechanism=None, runs=[0], _moved_by=lambda *_: moved)
    first, _ = cell_arm.CellArm.consequences(arm, {}, {"payload": {}})
    assert "up to 4.00 mm (rms 2.92)" in first


def test_a_fold_without_joints_is_refused_in_one_line(tmp_path):
    run = tmp_path / "0"
    run.mkdir()
    (run / "run.yaml").write_text(yaml.safe_dump({"schema": 1, "strip": "denim"}))
    with refusal("cell fold --arm fci"):
        open_mechanism(FILE, [RunFolder(run, "0")])
