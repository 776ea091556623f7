"""Simulated swings of pendulums with hidden causes, by fine steps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import yaml

from cell.gap.subject.mechanism.mechanism_file import PendulumFile
from drivers.types import Array
from tests.support.mechanisms import write_run

STEP = 0.0005  # s of the plant
LINK = {"mass": 0.2, "length": None, "com": 0.12, "inertia": 5e-4, "damping": 2.5e-4}
PENDULUM = PendulumFile.model_validate(
    {"schema": 1, "kind": "pendulum", "name": "made", "gravity": 9.81, "links": [LINK]}
)

Law = Callable[[Array, Array, int], Array]
"""Torques (n,) that oppose the joints, of their bend from hanging, their rate, the run's index."""


@dataclass(frozen=True, slots=True)
class Made:
    """Simulated run: times (m,) [s], noisy angles from upright (n, m) [rad], and its label."""

    t: Array
    angles: Array
    condition: str


def make_swings(
    pendulum: PendulumFile,
    lifts: Sequence[Array],
    sigma: float,
    rng: np.random.Generator,
    law: Law | None = None,
    span: float = 2.5,
    rate: float = 100.0,
) -> list[Made]:
    """Swings released from rest with links `lifts` (n,) [rad] off hanging."""
    model = mujoco.MjModel.from_xml_string(pendulum.xml())
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    labels = [f"lift {' '.join(f'{v:.1f}' for v in lift)}" for lift in lifts]
    runs = []
    for index, (lift, label) in enumerate(zip(lifts, labels, strict=True)):
        near = np.asarray(lift) * (1.0 + 0.02 * rng.standard_normal())
        t, angles = _released(model, near, law, index, span, rate)
        runs.append(Made(t, angles + sigma * rng.standard_normal(angles.shape), label))
    return runs


def write_swings(
    folder: Path, pendulum: PendulumFile, runs: Sequence[Made], sigma: float
) -> tuple[Path, Path]:
    """Write the pendulum's file and the run folders; returns both paths."""
    file = folder / "pendulum.yaml"
    stated = pendulum.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    file.write_text(yaml.safe_dump({"schema": 1, **stated}, sort_keys=False), encoding="utf-8")
    for index, made in enumerate(runs):
        head = {"pendulum": pendulum.name, "index": index, "condition": made.condition}
        columns = {"t": made.t} | {f"theta_{i + 1}": a for i, a in enumerate(made.angles)}
        run = folder / "runs" / f"{index:02d}"
        write_run(run, columns, {**head, "sigma": {"angle": sigma}}, "angles.parquet")
    return file, folder / "runs"


def _released(
    model: mujoco.MjModel, lift: Array, law: Law | None, index: int, span: float, rate: float
) -> tuple[Array, Array]:
    """Times (m,) [s] and absolute angles (n, m) [rad] of one release from `lift` (n,)."""
    data = mujoco.MjData(model)
    data.qpos[:] = np.diff(lift, prepend=0.0)
    every = round(1.0 / (rate * STEP))
    seen = [lift]
    for k in range(int(span * rate) * every):
        if law is not None:
            bend = data.qpos + 0.5 * STEP * data.qvel  # in the middle of the step
            turn = data.qvel + 0.5 * STEP * data.qacc
            data.qfrc_applied[:] = -law(bend, turn, index)
        mujoco.mj_step(model, data)
        if (k + 1) % every == 0:
            seen.append(np.cumsum(data.qpos))
    return np.arange(len(seen)) / rate, np.pi + np.array(seen).T
