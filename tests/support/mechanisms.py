"""Small arm with two motors, and runs of it by plain MuJoCo with hidden causes."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_folders import find_runs
from drivers.base.readers import read_yaml
from drivers.base.types import Array

ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" integrator="RK4" timestep="0.002"/>
  <worldbody>
    <body name="upper">
      <inertial pos="0 0 -0.15" mass="1.0" diaginertia="0.01 0.01 0.001"/>
      <joint name="shoulder" axis="0 1 0" damping="0.3" armature="0.02"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0"/>
      <body name="lower" pos="0 0 -0.3">
        <inertial pos="0 0 -0.12" mass="0.5" diaginertia="0.004 0.004 0.0005"/>
        <joint name="elbow" axis="0 1 0" damping="0.1" armature="0.01"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0 0 -0.24" size="0.02" mass="0"/>
        <site name="tip" pos="0 0 -0.24"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a1" joint="shoulder" kp="60"/>
    <position name="a2" joint="elbow" kp="30"/>
  </actuator>
</mujoco>
"""
FORWARD: dict[str, Any] = read_yaml(Path(__file__).with_suffix(".yaml"))
PRESCRIBED: dict[str, Any] = {
    **FORWARD, "mode": "prescribed",
    "signals": {"t1": {"actuator": "a1", "is": "torque", "sigma": 0.02},
                "t2": {"actuator": "a2", "is": "torque", "sigma": 0.02}},
    "inputs": {"shoulder": "position", "elbow": "position"},
}  # fmt: skip
NOISE = {"shoulder": 3e-4, "elbow": 3e-4, "t1": 0.02, "t2": 0.02, "a2_torque": 0.02}
Hidden = Callable[[Any], None]


def write_run(
    out: Path,
    columns: Mapping[str, Array],
    head: Mapping[str, Any],
    table: str = "signals.parquet",
) -> None:
    """A run folder `out` with columns (m,) by name in a `table`, and the header
    `head`.
    """
    out.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(dict(columns)), out / table)
    (out / "run.yaml").write_text(yaml.safe_dump({"schema": 1, **head}))


def make_arm(
    folder: Path,
    count: int = 6,
    hidden: Hidden | None = None,
    content: dict[str, Any] = FORWARD,
    span: float = 3.0,
    stated: str = ARM,
    plant: str = "",
) -> tuple[Path, Path]:
    """The arm's file and folder of runs; `hidden` edits the plant, as `stated`, that
    makes them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.xml").write_text(stated)
    file = folder / "arm.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    model = mujoco.MjModel.from_xml_string(plant or stated)
    model.opt.timestep = 0.0005
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if hidden is not None:
        hidden(model)
    rng = np.random.default_rng(3)
    for i in range(count):
        columns = moved(model, 0.5 + 0.5 * i, span)
        noisy = dict(columns)
        for n, sigma in NOISE.items():
            noisy[n] = columns[n] + rng.normal(0.0, sigma, len(columns[n]))
        write_run(folder / "runs" / f"{i:02d}", noisy, {"mechanism": "arm", "index": i})
    return file, folder / "runs"


def opened(file: Path, runs: Path) -> MechanismSubject:
    """The mechanism of a `file` with the recordings in the folder `runs`."""
    return open_mechanism(file, find_runs([runs]))


def left(subject: MechanismSubject, **effects: Any) -> float:
    """Rms residual [noise] that the stated model with `effects` leaves in all runs."""
    known = {name: np.array(values) for name, values in effects.items()}
    asked = [subject.stated(run, known) for run in subject.runs]
    found = [
        f.mean / r.samples.noise
        for r, f in zip(subject.runs, subject.simulate(asked), strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(found) ** 2)))


def moved(model: Any, rate: float, span: float) -> dict[str, Array]:
    """Columns (m,) of a motion under commands that go there and back, faster by
    `rate`.
    """
    data, rows = mujoco.MjData(model), []
    for k in range(round(span / model.opt.timestep)):
        held = np.floor(data.time / 0.01 + 1e-6) * 0.01
        before = data.actuator_force.copy()
        data.ctrl[:] = (
            0.8 * np.sin(2.0 * rate * held),
            0.9 * np.sin(3.1 * rate * held) + 0.3 * np.sin(0.7 * rate * held),
        )
        if k % 10 == 0:
            mujoco.mj_forward(model, data)
            # a command that steps is read as its mean
            force = data.actuator_force.copy()
            mean = 0.5 * (before + force)
            rows.append([data.time, *data.qpos[-2:], *data.ctrl, *mean, force[1]])
        mujoco.mj_step(model, data)
    names = ("t", "shoulder", "elbow", "a1", "a2", "t1", "t2", "a2_torque")
    return dict(zip(names, np.array(rows).T, strict=True))
