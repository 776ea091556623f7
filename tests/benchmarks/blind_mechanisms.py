"""Effects hidden in an arm, to be found blind, a line of JSON a case in OUT/cases.jsonl.

`python -m tests.benchmarks.blind_mechanisms OUT [--first N] [--count N] [--mode MODE]`. The plant
is integrated with another integrator at a quarter of the step, its friction is MuJoCo's own,
damping differs by 2 % from run to run. One case in ten hides nothing, one a cable that catches at
one angle, which is outside the library.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from cell.gap.fit import fit
from cell.gap.subject.mechanism.importer import write_run
from drivers.types import Array
from tests.support.mechanisms import ARM, FORWARD, NOISE, PRESCRIBED, moved

RUNS, SPAN = 8, 4.0
Edit = Callable[[Any, float], None]
Reading = Callable[[dict[str, Array], float], None]


def _friction(m: Any, s: float) -> None:
    m.dof_frictionloss[:] = 0.15 * s, 0.08 * s


def _quadratic(m: Any, s: float) -> None:
    m.dof_dampingpoly[:, 0] = 0.06 * s, 0.03 * s


def _spring(m: Any, s: float) -> None:
    m.jnt_stiffness[:] = 0.4 * s, 0.2 * s


def _armature(m: Any, s: float) -> None:
    m.dof_armature[:] += 0.02 * s, 0.008 * s


def _payload(m: Any, s: float) -> None:
    m.body_mass[2] += 0.08 * s
    m.body_ipos[2, 2] -= 0.12 * 0.08 * s / (0.5 + 0.08 * s)


def _constant(m: Any, s: float) -> None:
    m.actuator_gainprm[:, 0] *= 1.0 + 0.08 * s
    m.actuator_biasprm[:, 1] *= 1.0 + 0.08 * s


def _bias(columns: dict[str, Array], s: float) -> None:
    columns["t1"] += 0.15 * s
    columns["t2"] -= 0.08 * s


def _encoder(columns: dict[str, Array], s: float) -> None:
    columns["elbow"] += 0.04 * s


def _catch(columns: dict[str, Array], s: float) -> None:
    """A cable that catches at one angle of the elbow and pulls there alone."""
    columns["t2"] += 0.4 * s * np.exp(-(((columns["elbow"] - 0.3) / 0.08) ** 2))


HIDDEN: dict[str, Edit | None] = {
    "nothing": None, "dry_friction": _friction, "quadratic_damping": _quadratic,
    "cable_spring": _spring, "armature": _armature, "payload": _payload, "outside": None,
    "torque_constant": _constant, "torque_bias": None, "encoder_bias": None,
}  # fmt: skip
READ: dict[str, Reading] = {"torque_bias": _bias, "encoder_bias": _encoder, "outside": _catch}


def make_case(number: int, folder: Path, mode: str) -> tuple[str, Path]:
    """Runs with what is hidden in case `number`; its name and the mechanism's file."""
    rng = np.random.default_rng(1000 + number)
    name = list(HIDDEN)[number % len(HIDDEN)]
    size = float(rng.uniform(0.7, 1.5))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.xml").write_text(ARM)
    content = PRESCRIBED if mode == "prescribed" else FORWARD
    (folder / "arm.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    for i in range(RUNS):
        model = mujoco.MjModel.from_xml_string(ARM)
        model.opt.timestep = 0.0005
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        edit = HIDDEN[name]
        if edit is not None:
            edit(model, size)
        model.dof_damping[:] *= 1.0 + 0.02 * rng.standard_normal(2)
        columns = moved(model, float(rng.uniform(0.4, 2.5)), SPAN)
        if name in READ:
            READ[name](columns, size)
        for key, sigma in NOISE.items():
            columns[key] = columns[key] + rng.normal(0.0, sigma, len(columns[key]))
        write_run(folder / "runs" / f"{i:02d}", columns, {"mechanism": "arm", "index": i})
    return name, folder / "arm.yaml"


def scored(name: str, verdict: Any) -> str:
    """How a verdict answers what was hidden."""
    named = [e.name for e in verdict.effects]
    classes = [n for group in verdict.ambiguous for n in group]
    if name == "nothing":
        return "right" if verdict.verdict == "no_gap" else "wrong" if named else "open"
    if name == "outside":
        return "wrong" if named else "open"
    if named == [name]:
        return "right"
    if name in named or name in classes:
        return "class"
    return "wrong" if named or classes else "open"


def main() -> None:
    """Make, fit, score, append."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--mode", choices=("prescribed", "forward"), default="prescribed")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for number in range(given.first, given.first + given.count):
        folder = given.out / f"{number:03d}"
        name, file = make_case(number, folder, given.mode)
        began = time.process_time()
        verdict = fit([folder / "runs"], file, folder / "verdict")
        row = {
            "case": number, "hidden": name, "verdict": verdict.verdict,
            "effects": {e.name: {k: p.value for k, p in e.parameters.items()}
                        for e in verdict.effects},
            "ambiguous": verdict.ambiguous, "score": scored(name, verdict),
            "processor": round(time.process_time() - began, 1),
        }  # fmt: skip
        with (given.out / "cases.jsonl").open("a", encoding="utf-8") as ledger:
            ledger.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
