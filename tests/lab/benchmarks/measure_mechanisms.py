"""Published measurements of real mechanisms as runs: `python -m tests.lab
measure-mechanisms driven|servo OUT [--data DIR]` writes them into OUT and prints the
command that fits them.
"""

import json
from pathlib import Path
from typing import Literal

import numpy as np

from cell.gap.subject.run_table import read_table
from tests.support.mechanisms import write_run
from tests.support.shared import DATA

CONFIGS = Path(__file__).parents[3] / "configs" / "mechanisms"
# arXiv 2410.08650, XL-330
KT, OHM, PER_RAD = 0.323, 4.76, 4096.0 / (2.0 * np.pi * 256.0 * 885.0)
ON = 0.5


def driven(data: Path, out: Path) -> Path:
    """Runs of the driven double pendulum; its mechanism file."""
    columns = {"t": "time", "shoulder": "pos_meas1", "elbow": "pos_meas2",
               "shoulder_torque": "tau_meas1", "elbow_torque": "tau_meas2"}  # fmt: skip
    for i, path in enumerate(
        sorted((data / "driven_pendulum" / "A.0").glob("*.parquet"))
    ):
        table = read_table(path)
        found = {name: table[column] for name, column in columns.items()}
        write_run(
            out / "runs" / path.stem,
            found,
            {"mechanism": "driven-pendulum", "index": i},
        )
    return CONFIGS / "driven-pendulum" / "mechanism.yaml"


def servo(data: Path, out: Path) -> Path:
    """Runs of the servo, the motor's torque by its firmware's law; its mechanism
    file.
    """
    for i, path in enumerate(sorted((data / "servo" / "xl330").glob("*.parquet"))):
        table, stated = (
            read_table(path),
            json.loads(path.with_suffix(".json").read_text()),
        )
        error = table["goal_position"] - table["position"]
        duty = np.clip(stated["kp"] * PER_RAD * error, -1.0, 1.0)
        torque = KT * stated["vin"] * duty / OHM
        # a motor that is off: no duty, no back-EMF
        torque[table["torque_enable"] < ON] = np.nan
        found = {"t": table["t"], "servo": table["position"], "motor_torque": torque}
        condition = f"{stated['trajectory']} {stated['kp']}"
        head = {"mechanism": "servo", "index": i, "condition": condition}
        write_run(out / "runs" / path.stem, found, head)
    return CONFIGS / "servo" / "mechanism.yaml"


def main(which: Literal["driven", "servo"], out: Path, data: Path = DATA) -> None:
    """Convert, and print the command that fits."""
    file = {"driven": driven, "servo": servo}[which](data, out)
    print(f"cell gap fit {out / 'runs'} --model {file} --out {out / 'verdict'}")
