"""The pendulum as a subject: its physics and the files it reads."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from cell.base.config.places import CHECKOUT_CONFIGS
from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_folders import RunFolder
from cell.record.files import ANGLES
from drivers.base.types import Array
from tests.support.mechanisms import write_run
from tests.support.run_edits import edit_yaml
from tests.support.swings import PENDULUM, make_swings

TRIPLE = CHECKOUT_CONFIGS / "mechanisms" / "triple-pendulum"
SIGMA = 0.001
TORQUES = np.array([1e-3, 5e-4, 2e-4])


def subject_of(
    folder: Path, name: str, out: Path, t: Array, angles: Array
) -> MechanismSubject:
    """A pendulum, in steps of 2 ms, with a run of absolute angles (n, m) [rad] from
    rest.
    """
    shutil.copytree(folder, out, dirs_exist_ok=True)
    (file,) = out.glob("*.yaml")
    edit_yaml(file, step=0.002)
    table = {"t": t} | {f"theta_{i}": a for i, a in enumerate(angles, start=1)}
    slopes = np.diff(angles, axis=1, prepend=angles[:, :1]) / np.diff(t, prepend=-1.0)
    table |= {f"omega_{i}": rate for i, rate in enumerate(slopes, start=1)}
    write_run(out / "r", table, {"pendulum": name, "sigma": {"angle": SIGMA}}, ANGLES)
    return open_mechanism(file, [RunFolder(out / "r", "r")])


def residuals(subject: MechanismSubject, effects: dict[str, Array]) -> Array:
    return subject.simulate([subject.stated(subject.runs[0], effects)])[0].mean


@pytest.mark.parametrize(
    ("effects", "law"),
    [
        ({}, None),
        (
            {"dry_friction": [1e-3, 5e-4, 2e-4]},
            lambda _, r, __: TORQUES * np.tanh(r / 0.02),
        ),
    ],
    ids=["plain", "dry"],
)
def test_chain_moves_as_finer_steps_and_a_plain_law_say(
    tmp_path, effects, law: Any
) -> None:
    lift, rng = np.array([0.5, 0.65, -0.35]), np.random.default_rng(0)
    (made,) = make_swings(TRIPLE / "model.xml", [lift], 0.0, rng, law, span=1.0)
    subject = subject_of(TRIPLE, "triple-pendulum", tmp_path, made.t, made.angles)
    left = residuals(subject, {k: np.array(v) for k, v in effects.items()})
    np.testing.assert_allclose(left, 0.0, atol=1e-4)


def test_a_yielding_pivot_lengthens_the_swing(tmp_path) -> None:
    """To first order as if the link had more inertia: its pull moves the pivot to and
    fro.
    """
    model = mujoco.MjModel.from_xml_path(str(PENDULUM / "model.xml"))
    t, compliance = np.arange(0.0, 1.5, 0.004), 5e-4
    moment = float(-model.body_ipos[1, 2] * model.body_mass[1])
    inertia = float(model.body_inertia[1, 1] + moment**2 / model.body_mass[1])
    weight = -moment * model.opt.gravity[2]
    yields = compliance * moment**2 * weight / inertia
    rate = np.sqrt(weight / (inertia + yields))
    angles = np.pi + 0.02 * np.cos(rate * t)[None]
    subject = subject_of(PENDULUM, "made", tmp_path, t, angles)
    stated = subject.stated(subject.runs[0])
    undamped = replace(stated, base=np.array([0.0, *stated.base[1:]]))
    soft = replace(undamped, effects={"pivot_compliance": np.array([compliance])})
    stiff, right = (np.abs(f.mean).max() for f in subject.simulate([undamped, soft]))
    # what is left is a ring of the pivot, which starts at rest
    assert right < 0.25 * stiff
