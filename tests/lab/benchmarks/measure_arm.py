"""Faults hidden in the cell's arm, found from the paths of folds through the robot's library.

`python -m tests.lab measure-arm OUT [--faults NAME]...` hides each fault in turn in a
served robot, drives it in lock-step along FOLDS paths of a fold, in the air, by the client
library, fits what `cell fold --arm fci` would have kept of its joints, and appends a line of JSON
a fault to OUT/faults.jsonl. Links are 1 % heavier or lighter than the model, by chance.
`... model` writes the arm's MJCF into configs/mechanisms/arm.
"""

import json
import time
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml

from cell.config.places import find_configs
from cell.devices.fci import fci_arm, start_joints
from cell.devices.fold_path import triangle, whole_path
from cell.gap.fit import fit
from cell.record.files import JOINTS, RUN
from cell.record.tables import joint_table, write_parquet
from drivers.arm.reach import dense
from drivers.fci_server.server import RobotServer, ServerSettings
from drivers.franka.model import ArmPlant, arm_mjcf
from drivers.twin.clock import TwinClock
from drivers.types import Array, Velocity, frozen

ARM = Path(__file__).parents[3] / "configs" / "mechanisms" / "arm"
FOLDS = ((0.60, 0.16), (0.45, 0.12), (0.52, 0.19))
STEP, GAIN, RAISED = 0.02, 3.0, 0.1  # s, 1/s, m
FAULTS: Mapping[str, Mapping[str, Any]] = {
    "nothing": {},
    "dry_friction": {"friction": (0.4, 0.5, 0.3, 0.6, 0.3, 0.2, 0.3)},
    "payload": {"payload": 0.25},
    "torque_bias": {"torque_bias": (0.3, -0.6, 0.5, 0.4, -0.3, 0.3, 0.2)},
    "control_delay": {"delay": 0.006},
    "joint_elasticity": {"compliance": (7e-5, 7e-5, 7e-5, 7e-5, 1e-4, 1e-4, 1e-4)},
    "encoder_bias": {"encoder_bias": (0.0, 0.012, 0.0, -0.015, 0.0, 0.02, 0.0)},
    "cable_spring": {"cable": (0.5, 0.6, 0.4, 0.5, 0.3, 0.3, 0.3)},
    "torque_constant": {"torque_scale": (0.06, 0.05, -0.06, 0.06, -0.05, 0.06, 0.05)},
}


def drive(plant: ArmPlant, length: float, speed: float) -> Array:
    """Ticks of the joints (n, 29) along the path of a fold of a strip of `length` [m] in the air,
    lifted by RAISED, at `speed` [m/s].
    """
    settings = find_configs(None).cell()
    patient = settings.fci.model_copy(update={"start": 60.0, "answer": 60.0})
    settings = settings.model_copy(update={"fci": patient})
    installation = settings.fci.limit(settings.installation)
    plan = settings.fold.model_copy(update={"speed": speed, "lay_speed": speed})
    home = settings.twin.arm.home_height
    path, speeds = whole_path(length, home, plan, installation.limits, triangle(length))
    path[1:, 1] += RAISED
    poses, times = dense(path, np.minimum(speeds, speed))
    due = 1.5 * np.concatenate([[0.0], np.cumsum(times[1:])])
    start = start_joints(installation, settings.fold, length, home)
    clock = TwinClock()
    with RobotServer(ServerSettings(plant=plant), start=frozen(start)) as server:
        arm, _ = fci_arm(settings, clock, server.address)
        arm.connect()
        try:
            for k in range(int((due[-1] + 0.5) / STEP)):
                here, soon = (_at((k + i) * STEP, due, poses) for i in range(2))
                away = here - arm.state().commanded.as_array()
                most = [axis.velocity for axis in installation.limits.axes]
                rate = np.clip((soon - here) / STEP + GAIN * away, np.negative(most), most)
                arm.set_velocity(Velocity(*rate.tolist()))
                clock.wait_until((k + 1) * STEP)
        finally:
            arm.close()
        return arm.joints


def _at(t: float, due: Array, poses: Array) -> Array:
    return np.array([np.interp(t, due, column) for column in poses.T])


def make(folder: Path, name: str, seed: int) -> None:
    """Record runs of an arm with the fault `name` in `folder`."""
    rng = np.random.default_rng(seed)
    heavier = tuple(map(float, 0.01 * rng.standard_normal(7)))
    for k, (length, speed) in enumerate(FOLDS):
        plant = ArmPlant(mass_error=heavier, seed=100 * seed + k, **FAULTS[name])
        rows = drive(plant, length, speed)
        run = folder / f"{k:02d}"
        run.mkdir(parents=True, exist_ok=True)
        write_parquet(run / JOINTS, joint_table(rows, 0.0))
        head = {"schema": 1, "condition": f"{length:g} m at {speed:g} m/s", "index": k}
        (run / RUN).write_text(yaml.safe_dump(head, sort_keys=False))


def score(name: str, verdict: Any) -> str:
    """`right`, `class`, `open` or `wrong`: how a verdict answers what was hidden."""
    named = [e.name for e in verdict.effects]
    if name == "nothing":
        return "right" if verdict.verdict == "no_gap" else "wrong" if named else "open"
    if named == [name]:
        return "right"
    others = [n for n in named if n != name]
    if not others and any(name in group for group in verdict.ambiguous):
        return "class"
    return "wrong" if others else "open"


def main(
    out: Path,
    faults: Annotated[list[str], typer.Option()] = list(FAULTS),  # noqa: B006  not changed
    seed: int = 1,
    jobs: int = 1,
) -> None:
    """Hide, drive, fit, score, append."""
    if str(out) == "model":
        root = ET.fromstring(arm_mjcf())  # noqa: S314  our own text
        ET.indent(root)
        (ARM / "model.xml").write_text(ET.tostring(root, encoding="unicode") + "\n")
        return
    for number, name in enumerate(faults):
        folder, began = out / name, time.process_time()
        if not (folder / "runs").is_dir():
            make(folder / "runs", name, 10 * seed + number)
        drove = time.process_time() - began
        verdict = fit([folder / "runs"], ARM / "mechanism.yaml", folder / "verdict", jobs=jobs)
        row = {
            "hidden": name, "verdict": verdict.verdict, "score": score(name, verdict),
            "effects": {e.name: {k: [p.value, p.low, p.high] for k, p in e.parameters.items()}
                        for e in verdict.effects},
            "ambiguous": verdict.ambiguous, "notes": verdict.notes,
            "simulations": verdict.simulations, "drove": round(drove, 1),
            "processor": round(time.process_time() - began - drove, 1),
        }  # fmt: skip
        with (out / "faults.jsonl").open("a", encoding="utf-8") as ledger:
            ledger.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
