"""The pendulum as a subject: its physics and the files it reads."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.gap.subject.mechanism.mechanism_file import PendulumFile
from cell.gap.subject.mechanism.pendulum import Pendulum, open_recordings
from cell.gap.subject.mechanism.recordings import Recording
from cell.gap.subject.mechanism.subject import MechanismSubject
from drivers.types import Array
from tests.support.swings import make_swings

LINKS = (
    {"mass": 0.2, "length": 0.2, "com": 0.12, "inertia": 5e-4, "damping": 3e-4},
    {"mass": 0.15, "length": 0.18, "com": 0.1, "inertia": 3e-4, "damping": 1e-4},
    {"mass": 0.1, "length": None, "com": 0.1, "inertia": 2e-4, "damping": 5e-5},
)
SIGMA = 0.001
TORQUES = np.array([1e-3, 5e-4, 2e-4])


def pendulum(n: int) -> PendulumFile:
    links = [*LINKS[: n - 1], {**LINKS[n - 1], "length": None}]
    return PendulumFile.model_validate(
        {"schema": 1, "kind": "pendulum", "name": f"p{n}", "gravity": 9.81, "links": links}
    )


def subject_of(file: PendulumFile, t: Array, angles: Array) -> MechanismSubject:
    """A pendulum with one recording of absolute angles (n, m) [rad] from rest, in steps of 2 ms."""
    columns = {str(i): angle - np.pi for i, angle in enumerate(angles, start=1)}
    found = [Recording("r", "r", 0, t, columns, sigma=SIGMA, rates=np.zeros(len(angles)))]
    opened = open_recordings(Path("pendulum.yaml"), file, found)
    opened.mechanism.model.opt.timestep = 0.002
    return Pendulum(replace(opened, mechanism=replace(opened.mechanism, step=0.002)))


def residuals(subject: MechanismSubject, effects: dict[str, Array]) -> Array:
    return subject.simulate([subject.stated(subject.runs[0], effects)])[0].mean


@pytest.mark.parametrize(
    ("effects", "law"),
    [
        ({}, None),
        ({"dry_friction": [1e-3, 5e-4, 2e-4]}, lambda _, r, __: TORQUES * np.tanh(r / 0.02)),
    ],
    ids=["plain", "dry"],
)
def test_chain_moves_as_finer_steps_and_a_plain_law_say(effects: Any, law: Any) -> None:
    file, lift = pendulum(3), np.array([0.5, 0.65, -0.35])
    (made,) = make_swings(file, [lift], 0.0, np.random.default_rng(0), law, span=1.0)
    left = residuals(subject_of(file, made.t, made.angles),
                     {k: np.array(v) for k, v in effects.items()})  # fmt: skip
    np.testing.assert_allclose(left, 0.0, atol=1e-4)


def test_a_yielding_pivot_lengthens_the_swing() -> None:
    """To first order as if the link had more inertia: its pull moves the pivot to and fro."""
    file, t, compliance = pendulum(1), np.arange(0.0, 1.5, 0.004), 5e-4
    link = file.links[0]
    moment = link.mass * link.com
    inertia = link.inertia + moment * link.com
    weight = moment * file.gravity
    yields = compliance * moment**2 * weight / inertia
    rate = np.sqrt(weight / (inertia + yields))
    subject = subject_of(file, t, np.pi + 0.02 * np.cos(rate * t)[None])
    stated = subject.stated(subject.runs[0])
    undamped = replace(stated, base=np.array([0.0, *stated.base[1:]]))
    soft = replace(undamped, effects={"pivot_compliance": np.array([compliance])})
    stiff, right = (np.abs(f.mean).max() for f in subject.simulate([undamped, soft]))
    assert right < 0.25 * stiff  # what is left is a ring of the pivot, which starts at rest
