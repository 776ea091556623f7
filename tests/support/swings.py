"""Simulated swings of pendulums with hidden causes, by fine steps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree

import mujoco
import numpy as np

from drivers.base.types import Array
from tests.support.mechanisms import write_run

STEP = 0.0005  # s of the plant
PENDULUM = Path(__file__).parent / "pendulum"
"""Folder of the file and the model of a pendulum of one link, called `made`."""

Law = Callable[[Array, Array, int], Array]
"""Torques (n,) that oppose the joints, of their bend from hanging, their rate, the
run's index.
"""


@dataclass(frozen=True, slots=True)
class Made:
    """Simulated run: times (m,) [s], noisy angles from upright (n, m) [rad], and its
    label.
    """

    t: Array
    angles: Array
    condition: str


def make_swings(
    file: Path,
    lifts: Sequence[Array],
    sigma: float,
    rng: np.random.Generator,
    law: Law | None = None,
    span: float = 2.5,
    rate: float = 100.0,
) -> list[Made]:
    """Swings of the model in `file`, released from rest with links `lifts` (n,) [rad]
    lifted.
    """
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    labels = [f"lift {' '.join(f'{v:.1f}' for v in lift)}" for lift in lifts]
    runs = []
    for index, (lift, label) in enumerate(zip(lifts, labels, strict=True)):
        near = np.asarray(lift) * (1.0 + 0.02 * rng.standard_normal())
        t, angles = _released(model, near, law, index, span, rate)
        runs.append(Made(t, angles + sigma * rng.standard_normal(angles.shape), label))
    return runs


def write_swings(folder: Path, runs: Sequence[Made], sigma: float) -> tuple[Path, Path]:
    """Write the pendulum's file, its model and the run folders; returns paths of file
    and runs.
    """
    copytree(PENDULUM, folder, dirs_exist_ok=True)
    for index, made in enumerate(runs):
        head = {"pendulum": "made", "index": index, "condition": made.condition}
        columns = {"t": made.t} | {
            f"theta_{i + 1}": a for i, a in enumerate(made.angles)
        }
        run = folder / "runs" / f"{index:02d}"
        write_run(run, columns, {**head, "sigma": {"angle": sigma}}, "angles.parquet")
    return folder / "pendulum.yaml", folder / "runs"


def rubbing(_: Array, rate: Array, __: int) -> Array:
    """Law of dry friction of 0.4 mN m."""
    return 4e-4 * np.tanh(rate / 0.005)


def swings_of(
    folder: Path, lifts: Sequence[float], seed: int, law: Law | None = None
) -> tuple[Path, Path]:
    """Paths of file and runs, in `folder`, of the pendulum released at `lifts` [rad],
    with a noise of 1 mrad.
    """
    rng = np.random.default_rng(seed)
    made = make_swings(
        PENDULUM / "model.xml", [np.array([a]) for a in lifts], 1e-3, rng, law
    )
    return write_swings(folder, made, 1e-3)


def _released(
    model: mujoco.MjModel,
    lift: Array,
    law: Law | None,
    index: int,
    span: float,
    rate: float,
) -> tuple[Array, Array]:
    """Times (m,) [s] and absolute angles (n, m) [rad] of one release from `lift`
    (n,).
    """
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
