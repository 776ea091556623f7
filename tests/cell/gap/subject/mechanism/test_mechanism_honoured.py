"""What a model of others holds is part of its prediction: nothing is ignored in
silence.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.gap.subject.mechanism.subject import MechanismSubject
from tests.support.mechanisms import ARM, FORWARD, PRESCRIBED, left, make_arm, opened
from tests.support.refusals import refusal
from tests.support.run_edits import edit_column, edit_yaml
from tests.support.shared import CASES, needs

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


def arm(folder: Path, **how: Any) -> MechanismSubject:
    return opened(*make_arm(folder, 2, **({"content": PRESCRIBED} | how)))


@pytest.mark.parametrize("name", MODELS)
def test_what_the_model_holds_is_predicted(tmp_path: Path, name: str) -> None:
    subject = arm(tmp_path / "stated", stated=MODELS[name])
    assert left(subject) < KNOWN
    assert left(arm(tmp_path / "left out", plant=MODELS[name])) > 18.0 * KNOWN
    notes = "".join(subject.notes)
    assert ("moments at the limits" in notes) == (name in ("limit", "rope"))
    assert "contacts are off" in notes


def test_commands_beyond_their_range_give_no_more_torque_through_gears_either(
    tmp_path,
) -> None:
    short = ARM.replace(' armature="0.01"', "").replace(
        'kp="30"', 'kp="30" ctrlrange="-0.3 0.3"'
    )
    soft = dict.fromkeys(("compliance_shoulder", "compliance_elbow"), 1e-5)
    accepted = FORWARD | {"effects": {"joint_elasticity": soft}}
    rigid, geared = (
        left(arm(tmp_path, stated=short, content=c)) for c in (FORWARD, accepted)
    )
    assert rigid < 8.0 * KNOWN
    assert geared == pytest.approx(rigid, rel=0.1)


def test_a_torque_is_read_on_the_side_that_the_file_states(tmp_path: Path) -> None:
    file, runs = make_arm(tmp_path, 2, content=PRESCRIBED, stated=MODELS["gear"])
    typical = opened(file, runs).mechanism.torque
    for table in runs.rglob("signals.parquet"):
        edit_column(table, "t2", lambda t2: 6.0 * t2)
    (wrong,) = opened(file, runs).contradictions()
    assert (wrong.what, wrong.remedy) == ("gear", "state side: joint")
    for spec in ({"side": "joint", "actuator": "a2"}, {"joint": "elbow"}):
        t2 = {"is": "torque", "sigma": 0.12, **spec}
        edit_yaml(file, signals=PRESCRIBED["signals"] | {"t2": t2})
        subject = opened(file, runs)
        assert left(subject) < KNOWN
        assert subject.mechanism.torque == pytest.approx(typical)


def test_a_heavier_link_is_its_effect(tmp_path: Path) -> None:
    def hidden(model: Any) -> None:
        model.body_mass[2] *= 2.0
        model.body_inertia[2] *= 2.0

    subject = arm(tmp_path, hidden=hidden)
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
    subject = arm(tmp_path, plant=plant)
    values = [*np.eye(6)[place] / stiffness, rate, rate / 1000]
    assert left(subject, base_compliance=values) < 0.2 * left(subject)


@needs(CASES)
def test_a_closed_loop_is_driven_through_its_equality(tmp_path: Path) -> None:
    case = CASES / "closed-loop"
    whole = opened(case / "model" / "robot.yaml", case / "runs")
    rest = left(whole)
    assert rest < 0.1  # of 0.05 N m, where the open tree leaves 1.45 N m
    assert "does not close" not in "".join(whole.notes)
    runs = shutil.copytree(case, tmp_path / "case") / "runs"
    file = runs.with_name("model") / "robot.yaml"
    for table in runs.rglob("signals.parquet"):
        edit_column(table, "coupler", lambda angle: 1.02 * angle)
    off = opened(file, runs)
    assert "does not close by 4.8 mm" in "".join(off.notes)
    assert left(off) == pytest.approx(rest)
    edit_yaml(file, inputs={"crank": "position"})
    assert left(opened(file, runs)) < 0.1
    # friction of a passive joint acts through the loop
    assert left(whole, dry_friction=[0.0, 0.0, 0.1] + 3 * [0.0]) > 5.0 * rest
    model = file.parent / "fourbar.xml"
    second = '<motor name="second" joint="rocker"/></actuator>'
    model.write_text(model.read_text().replace("</actuator>", second))
    with refusal("leave 1 degrees of freedom"):
        opened(file, runs)


@needs(CASES)
@pytest.mark.parametrize("fingers", ["hand", "hand2", "hand3"])
def test_an_arm_opens_with_its_hand_whatever_fingers_were_measured(
    tmp_path, fingers
) -> None:
    case = CASES / "hand-of-the-arm" / fingers
    whole = opened(case / "model" / "robot.yaml", case / "runs")
    assert left(whole) < 1.1  # of the noise
    stands = "joint finger1 has no column: it stands still"
    assert (stands in whole.notes) == (fingers == "hand")
    file = shutil.copytree(case / "model", tmp_path / "model") / "robot.yaml"
    file.write_text(file.read_text().replace("  elbow: position\n", ""))
    with refusal(r"inputs.elbow: is missing"):
        opened(file, case / "runs")
