"""An accepted mechanism: an MJCF that anybody can load, and a file that holds the
rest.
"""

import copy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import yaml

from cell.gap.subject.mechanism.effects import library
from cell.gap.subject.mechanism.model import Joint, Mechanism
from cell.gap.subject.mechanism.model_source import ModelSource
from cell.gap.subject.mechanism.patch import accepted_xml
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.verdict.accept import Change, accept, undo
from cell.interface.handover import export_fit
from drivers.base.readers import read_yaml
from tests.support.fit_folders import write_mechanism_fit
from tests.support.mechanisms import ARM, FORWARD, make_arm, opened

NAMED = read_yaml(Path(__file__).with_suffix(".yaml"))
RIG = {"encoder_bias": {"bias_shoulder": 0.01, "bias_elbow": -0.02}}
BASE = {"damping_shoulder": 0.35, "damping_left.elbow": 0.08, "mass_lower": 0.51}


def fitted_arm(root: Path) -> tuple[MechanismSubject, Path, Path, Path]:
    """An arm, its file and runs, and the folder of a fit that named NAMED and RIG."""
    elbow = {"joint": "left.elbow", "is": "position", "sigma": 3e-4}
    content = FORWARD | {"signals": FORWARD["signals"] | {"elbow": elbow}}
    stated = ARM.replace('"elbow"', '"left.elbow"')
    file, runs = make_arm(root / "arm", 2, content=content, span=1.0, stated=stated)
    arm, out = opened(file, runs), root / "out"
    write_mechanism_fit(out, file, arm, BASE, NAMED | RIG)
    return arm, file, runs, out


@pytest.mark.slow
@pytest.mark.parametrize("to", ["arm", "exported"])
def test_accepted_mjcf_in_plain_mujoco_moves_as_the_accepted_model(
    tmp_path: Path, to: str
) -> None:
    arm, file, _, out = fitted_arm(tmp_path)
    accept(out, file)
    export_fit(out, "mjcf", tmp_path / "exported")
    run, step = arm.runs[1], arm.mechanism.file.step
    values = {n: np.array(list(v.values())) for n, v in NAMED.items()}
    values["saturation"] = 1.0 / values["saturation"]
    base = np.array([BASE[p.name] for p in arm.scope.base])
    case = arm._case(replace(arm.stated(run, values), base=base))
    (predicted,) = arm.predict([case])

    plain = mujoco.MjModel.from_xml_path(f"{tmp_path}/{to}/arm-accepted.xml")
    data = mujoco.MjData(plain)
    data.qpos[:], data.qvel[:] = case.start
    rows = [data.qpos.copy()]
    for control in case.content.commands.at_steps(step, 600, 0.0):
        data.ctrl[:] = control
        mujoco.mj_step(plain, data)
        rows.append(data.qpos.copy())
    steps = case.content.cut.t / step
    k = np.rint(steps).astype(int)
    on_grid = np.abs(steps - k) < 1e-6
    moved = np.array(rows)[k[on_grid]].T
    assert on_grid.sum() > 20
    assert np.abs(moved - predicted[:2, on_grid]).max() < 1e-6
    assert np.abs(moved).max() > 0.1


def test_what_mjcf_cannot_say_stays_in_the_file_and_undo_takes_all_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, file, runs, out = fitted_arm(tmp_path)
    before, model = file.read_text(), (file.parent / "arm.xml").read_bytes()
    changed, check = list[str](), Change.check
    noted = lambda change: changed.append(change.path.name) or check(change)  # noqa: E731
    monkeypatch.setattr(Change, "check", noted)
    accept(out, file)
    content = yaml.safe_load(file.read_text())
    assert (content["effects"], content["model"]) == (RIG, "arm-accepted.xml")
    assert (file.parent / "arm.xml").read_bytes() == model
    starts = {p.name: p.start for p in opened(file, runs).scope.base}
    assert "encoder_bias.bias_elbow" in starts
    assert starts["damping_shoulder"] == BASE["damping_shoulder"]
    assert starts["mass_lower"] == BASE["mass_lower"] + NAMED["payload"]["mass"]
    undo(out, file)
    there = [content["model"], file.name]  # a file names no model that is not there
    assert changed == [*there, *there[::-1]]
    assert file.read_text() == before
    assert not (file.parent / content["model"]).exists()


def test_friction_is_written_to_the_pair_whose_geoms_it_is_of() -> None:
    """A compiled model orders pairs by its bodies, its document as they were
    written.
    """
    text = """<mujoco><worldbody><geom name="desk" type="plane" size="1 1 1"/>
        <body><joint name="x" type="slide"/><geom name="low" size=".1" mass="1"/>
        <body><joint name="y" type="slide"/><geom name="high" size=".1" mass="1"/></body></body>
        </worldbody><contact><pair name="b" geom1="high" geom2="desk" friction=".2 .2"/><pair
        name="a" geom1="low" geom2="desk" friction=".9 .9"/></contact></mujoco>"""
    source = ModelSource(text, Path(), Path())
    spec = source.spec()
    spec.nuser_jnt = 16
    model = spec.compile()
    joints = tuple(Joint(name, False, -1, 1.0, 1.0, 1.0, 1.0) for name in "xy")
    m = Mechanism(
        SimpleNamespace(mode="forward", step=0.002), Path(), source, model, (), joints
    )
    edited = copy.copy(model)
    library()["contact_friction"].edit(m, np.array([0.05]), edited)
    new = mujoco.MjModel.from_xml_string(accepted_xml(m, edited))
    np.testing.assert_allclose(
        [new.pair(name).friction[0] for name in "ab"], [0.95, 0.25]
    )
