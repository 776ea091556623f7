"""What a model of others holds is part of its prediction: nothing is ignored in
silence.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.run_table import read_table
from drivers.base.errors import ConfigurationError
from tests.support.mechanisms import ARM, FORWARD, PRESCRIBED, left, make_arm, write_run

CASES = Path(__file__).parents[6] / "shared" / "cases"
cases = pytest.mark.skipif(not CASES.is_dir(), reason=f"no cases in {CASES}")
ELBOW = 'name="elbow" axis="0 1 0"'
MODELS = {
    "friction": ARM.replace(ELBOW, f'{ELBOW} frictionloss="0.5"'),
    "compensated": (
        ARM.replace(ELBOW, f'{ELBOW} actuatorgravcomp="true"').replace(
            '<body name="lower"', '<body name="lower" gravcomp="1"'
        )
    ),
    "limit": ARM.replace(ELBOW, f'{ELBOW} limited="true" range="-0.6 0.6"'),
    "rope": ARM.replace(
        "<actuator>",
        '<tendon><fixed limited="true" range="-0.6 0.6"><joint '
        'joint="elbow" coef="1"/></fixed></tendon><actuator>',
    ),
    "force": ARM.replace(
        ELBOW, f'{ELBOW} actuatorfrclimited="true" actuatorfrcrange="-1 1"'
    ),
    "gear": ARM.replace('joint="elbow" kp="30"', 'joint="elbow" kp="1" gear="6"'),
}
KNOWN = 0.5  # of the noise: what the filter and friction near a stop leave


def opened(folder: Path, **arm: Any) -> MechanismSubject:
    file, runs = make_arm(folder, 2, content=arm.pop("content", PRESCRIBED), **arm)
    return open_mechanism(file, find_runs([runs]))


@pytest.mark.parametrize("name", MODELS)
def test_what_the_model_holds_is_predicted(tmp_path: Path, name: str) -> None:
    subject = opened(tmp_path / "stated", stated=MODELS[name])
    assert left(subject) < KNOWN
    assert left(opened(tmp_path / "left out", plant=MODELS[name])) > 18.0 * KNOWN
    told = any(note.startswith("moments at the limits") for note in subject.notes)
    assert told == (name in ("limit", "rope"))
    assert any("contacts are off" in note for note in subject.notes)


def test_commands_beyond_their_range_give_no_more_torque_through_gears_either(
    tmp_path,
) -> None:
    short = ARM.replace(' armature="0.01"', "").replace(
        'kp="30"', 'kp="30" ctrlrange="-0.3 0.3"'
    )
    soft = dict.fromkeys(("compliance_shoulder", "compliance_elbow"), 1e-5)
    accepted = FORWARD | {"effects": {"joint_elasticity": soft}}
    rigid, geared = (
        left(opened(tmp_path, stated=short, content=c)) for c in (FORWARD, accepted)
    )
    assert rigid < 8.0 * KNOWN
    assert geared == pytest.approx(rigid, rel=0.1)


def test_a_torque_is_read_on_the_side_that_the_file_states(tmp_path: Path) -> None:
    file, runs = make_arm(tmp_path, 2, content=PRESCRIBED, stated=MODELS["gear"])
    typical = open_mechanism(file, find_runs([runs])).mechanism.torque
    for run in runs.iterdir():
        table = read_table(run / "signals.parquet")
        write_run(run, {**table, "t2": 6.0 * table["t2"]}, {"mechanism": "arm"})
    (wrong,) = open_mechanism(file, find_runs([runs])).contradictions()
    assert (wrong.what, wrong.remedy) == ("gear", "state side: joint")
    content = yaml.safe_load(file.read_text())
    for spec in ({"side": "joint", "actuator": "a2"}, {"joint": "elbow"}):
        content["signals"]["t2"] = {"is": "torque", "sigma": 0.12, **spec}
        file.write_text(yaml.safe_dump(content))
        subject = open_mechanism(file, find_runs([runs]))
        assert left(subject) < KNOWN
        assert subject.mechanism.torque == pytest.approx(typical)


def test_a_heavier_link_is_its_effect(tmp_path: Path) -> None:
    def hidden(model: Any) -> None:
        model.body_mass[2] *= 2.0
        model.body_inertia[2] *= 2.0

    subject = opened(tmp_path, hidden=hidden)
    assert left(subject) > 3.0 * KNOWN
    assert left(subject, link_inertia=[0.0, 1.0]) < KNOWN


@pytest.mark.parametrize(
    ("joint", "place", "rate", "stiffness"),
    [
        ('type="slide" axis="1 0 0"', 0, 28.3, 6000.0),
        ('type="hinge" axis="0 1 0"', 4, 27.2, 300.0),
    ],
)
def test_a_base_that_sways_is_its_effect(
    tmp_path: Path, joint: str, place: int, rate: float, stiffness: float
) -> None:
    table = (
        f'<worldbody><body><joint {joint} stiffness="{stiffness}"'
        f' damping="{stiffness / 500}"/><inertial pos="0 0 0" mass="6" diaginertia="0.3'
        ' 0.3 0.3"/>'
    )
    plant = ARM.replace("<worldbody>", table).replace(
        "</worldbody>", "</body></worldbody>"
    )
    subject = opened(tmp_path, plant=plant)
    values = [*np.eye(6)[place] / stiffness, rate, rate / 1000]
    assert left(subject, base_compliance=values) < 0.2 * left(subject)


@cases
def test_a_closed_loop_is_driven_through_its_equality(tmp_path: Path) -> None:
    case = CASES / "closed-loop"
    whole = open_mechanism(case / "model" / "robot.yaml", find_runs([case / "runs"]))
    assert left(whole) < 0.1  # of 0.05 N m, where the open tree leaves 1.45 N m
    assert not any("does not close" in note for note in whole.notes)
    file = shutil.copytree(case, tmp_path / "case") / "model" / "robot.yaml"
    content = yaml.safe_load(file.read_text())
    for run in (tmp_path / "case" / "runs").iterdir():
        table = read_table(run / "signals.parquet")
        write_run(
            run, {**table, "coupler": table["coupler"] + 0.01}, {"mechanism": "fourbar"}
        )
    off = open_mechanism(file, find_runs([tmp_path / "case" / "runs"]))
    assert any("does not close by 3." in note for note in off.notes)
    assert left(off) == pytest.approx(left(whole))
    file.write_text(yaml.safe_dump({**content, "inputs": {"crank": "position"}}))
    assert left(open_mechanism(file, find_runs([tmp_path / "case" / "runs"]))) < 0.1
    rubbing = left(whole, dry_friction=[0.0, 0.0, 0.1] + 3 * [0.0])
    # friction of a passive joint acts through the loop
    assert rubbing > 5.0 * left(whole)
    model = file.parent / "fourbar.xml"
    second = '<motor name="second" joint="rocker"/></actuator>'
    model.write_text(model.read_text().replace("</actuator>", second))
    with pytest.raises(ConfigurationError, match="leave 1 degrees of freedom"):
        open_mechanism(file, find_runs([tmp_path / "case" / "runs"]))


@cases
@pytest.mark.parametrize("fingers", ["hand", "hand2", "hand3"])
def test_an_arm_opens_with_its_hand_whatever_fingers_were_measured(
    tmp_path, fingers
) -> None:
    case = CASES / "hand-of-the-arm" / fingers
    runs = find_runs([case / "runs"])
    whole = open_mechanism(case / "model" / "robot.yaml", runs)
    assert left(whole) < 1.1  # of the noise
    stands = "joint finger1 has no column: it stands still"
    assert (stands in whole.notes) == (fingers == "hand")
    file = shutil.copytree(case / "model", tmp_path / "model") / "robot.yaml"
    file.write_text(file.read_text().replace("  elbow: position\n", ""))
    with pytest.raises(ConfigurationError, match=r"inputs.elbow: is missing"):
        open_mechanism(file, runs)
