"""Faults of recordings, each of a random size, put into the runs of a mechanism."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.model import tip
from cell.gap.subject.run_table import read_table
from drivers.base.readers import read_yaml
from drivers.base.types import Array
from tests.support.mechanisms import write_run

Table = dict[str, Array]
NAMES = {"lag": {"sensor_delay"}, "drift": {"dry_friction", "presliding"}}
"""Effects that are right of a fault that is fitted all the same."""
UNITS = (1000.0, 100.0, 10.1972, 0.101972, 8.85075, 141.612, 0.001)  # in a newton metre
LATE, STANDS = (0.006, 0.03), (0.3, 1.0)  # s, least and most
TOUCHES = (0.6, 0.95)  # share of a motion
GREASE, WARM = (0.1, 0.4), 0.3  # share of a joint's torque, and what is left of it
PUSH = 0.5  # of a joint's torque, of a floor
THICK = 0.01  # m, of links that touch


class Recorder:
    """Tables of all runs of a mechanism in `out`, to be spoilt and written back.

    `angles` are columns of hinges, `torques` those of motors.
    """

    def __init__(self, out: Path, file: Path, rng: np.random.Generator) -> None:
        self.out, self.rng = out, rng
        content = read_yaml(file)
        self.model_file = out / content["model"]
        spec = mujoco.MjSpec.from_file(str(self.model_file))
        self.model = spec.compile()
        self.torques = [n for n, s in content["signals"].items() if s["is"] == "torque"]
        self.joints = [content["signals"][n]["joint"] for n in self.torques]
        self.angles = [
            n
            for n in content["inputs"]
            if self.model.joint(n).type[0] == mujoco.mjtJoint.mjJNT_HINGE
        ]
        self.runs = sorted((out / "study-runs").iterdir())
        self.tables = [read_table(run / "signals.parquet") for run in self.runs]

    def write(self) -> None:
        """Write all tables over those of the runs."""
        for run, table in zip(self.runs, self.tables, strict=True):
            write_run(run, table, read_yaml(run / "run.yaml"))

    def size(self, limits: tuple[float, float]) -> float:
        """A random number between `limits`."""
        return float(self.rng.uniform(*limits))


def spoil(out: Path, file: Path, fault: str, seed: int) -> None:
    """Put a `fault` of random size into the runs of the mechanism `file` in `out`."""
    recorder = Recorder(out, file, np.random.default_rng([seed, 1]))
    FAULTS[fault](recorder)
    recorder.write()


def _wrap(recorder: Recorder) -> None:
    """An encoder that begins a new turn within its motion."""
    name = str(recorder.rng.choice(recorder.angles))
    every = np.concatenate([table[name] for table in recorder.tables])
    edge = float(np.quantile(every, recorder.rng.uniform(0.2, 0.8)))
    for table in recorder.tables:
        table[name] = edge + np.mod(table[name] - edge, 2.0 * np.pi)


def _lag(recorder: Recorder) -> None:
    """Torques whose stamps are late, or early."""
    late = recorder.size(LATE) * recorder.rng.choice([-1.0, 1.0])
    for table in recorder.tables:
        for name in recorder.torques:
            table[name] = np.interp(table["t"] - late, table["t"], table[name])


def _sign(recorder: Recorder) -> None:
    """A motor whose torque counts the other way."""
    _scale(recorder, -1.0)


def _unit(recorder: Recorder) -> None:
    """A motor whose torque is in another unit."""
    _scale(recorder, float(recorder.rng.choice(UNITS)))


def _scale(recorder: Recorder, factor: float) -> None:
    name = str(recorder.rng.choice(recorder.torques))
    for table in recorder.tables:
        table[name] = factor * table[name]


def _stuck(recorder: Recorder) -> None:
    """A column of one run that stands for a while."""
    table = recorder.tables[recorder.rng.integers(len(recorder.tables))]
    name = str(recorder.rng.choice([*recorder.angles, *recorder.torques]))
    t, span = table["t"], recorder.size(STANDS)
    first = recorder.rng.uniform(t[0], t[-1] - span)
    stands = (t >= first) & (t <= first + span)
    table[name] = np.where(stands, table[name][stands][0], table[name])


def _contact(recorder: Recorder) -> None:
    """A floor on which the last link rests in most of the motion, and presses."""
    spec = mujoco.MjSpec.from_file(str(recorder.model_file))
    for body in spec.bodies[1:]:
        for site in body.sites:
            ends = [0.0, 0.0, 0.0, *site.pos]
            kind = mujoco.mjtGeom.mjGEOM_CAPSULE
            body.add_geom(type=kind, fromto=ends, size=[THICK, 0, 0], mass=0.0)
    heights = [_tip_heights(recorder, table) for table in recorder.tables]
    floor = float(np.quantile(np.concatenate(heights), recorder.size(TOUCHES)))
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(type=plane, pos=[0, 0, floor], size=[5, 5, 0.1])
    spec.compile()
    recorder.model_file.write_text(spec.to_xml())
    scale = float(np.ptp(np.concatenate(heights)))
    for table, height in zip(recorder.tables, heights, strict=True):
        depth = np.maximum(floor - height, 0.0) / scale
        for name in recorder.torques:
            table[name] = table[name] + PUSH * table[name].std() * depth


def _tip_heights(recorder: Recorder, table: Table) -> Array:
    """Heights (n,) [m] of the tip along a run."""
    m, data = recorder.model, mujoco.MjData(recorder.model)
    body, place = tip(m)
    found = []
    for i in range(len(table["t"])):
        data.qpos[:] = [table[m.joint(j).name][i] for j in range(m.njnt)]
        mujoco.mj_kinematics(m, data)
        found.append(data.xpos[body][2] + (data.xmat[body].reshape(3, 3) @ place)[2])
    return np.array(found)


def _drift(recorder: Recorder) -> None:
    """Friction that falls from run to run as grease warms."""
    most, last = recorder.size(GREASE), len(recorder.tables) - 1
    for k, table in enumerate(recorder.tables):
        share = most * (1.0 - (1.0 - WARM) * k / last)
        for name, joint in zip(recorder.torques, recorder.joints, strict=True):
            rate = np.gradient(table[joint], table["t"])
            slides = np.tanh(rate / (0.05 * rate.std()))
            table[name] = table[name] + share * table[name].std() * slides


FAULTS: dict[str, Callable[[Recorder], Any]] = {
    "wrapped": _wrap,
    "lag": _lag,
    "sign": _sign,
    "unit": _unit,
    "stuck reading": _stuck,
    "contact": _contact,
    "drift": _drift,
}
"""Faults by what a check is to call them."""
