"""A pendulum's file and runs, written as a mechanism."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cell.gap.subject.mechanism.file import PendulumFile
from cell.gap.subject.mechanism.pendulum import mechanism_of
from cell.gap.subject.run_folders import read_table
from drivers.readers import read_yaml
from drivers.settings import load
from tests.support.mechanisms import write_run

RADIUS = 0.005  # m of the rods that air brakes
DRAG = "1 0.1 0.93 0 0"  # blunt, slender, angular: a rod about its end, as integrated along it


def convert_pendulum(file: Path, runs: Sequence[Path], out: Path) -> Path:
    """The pendulum in `file` with its `runs` as a mechanism in `out`; the mechanism file.

    Angles are measured from hanging there; air drag's coefficient is per `drag_unit` [kg/m^2].
    """
    pendulum = load(file, PendulumFile)
    out.mkdir(parents=True, exist_ok=True)
    (out / "model.xml").write_text(pendulum_xml(pendulum))
    sigma = 0.0
    for path in runs:
        head = read_yaml(path / "run.yaml")
        sigma = float(head["sigma"]["angle"])
        table = read_table(path / "angles.parquet")
        columns = {"t": table["t"]}
        for i in range(1, len(pendulum.links) + 1):
            columns[f"angle_{i}"] = table[f"theta_{i}"] - np.pi
        kept: dict[str, Any] = {k: head[k] for k in ("index", "condition") if k in head}
        write_run(out / "runs" / path.name, columns, {"mechanism": pendulum.name, **kept})
    content = {
        "schema": 1, "kind": "mechanism", "name": pendulum.name, "model": "model.xml",
        "mode": "forward", "step": 0.01,
        "signals": {f"angle_{i + 1}": {"sensor": f"angle_{i + 1}", "sigma": sigma}
                    for i in range(len(pendulum.links))},
        "uncertain": [{"joint": "*", "field": "damping", "spread": _loose(pendulum)},
                      {"body": "*", "field": "com", "spread": 0.002},
                      {"body": "*", "field": "inertia", "spread": "10%"}],
    }  # fmt: skip
    place = out / "mechanism.yaml"
    place.write_text(yaml.safe_dump(content, sort_keys=False))
    return place


def drag_unit() -> float:
    """Force per length and squared speed [kg/m^2] of a converted pendulum at coefficient one."""
    return 0.5 * 1.2 * 2.0 * RADIUS * np.pi / 4.0


def _loose(pendulum: PendulumFile) -> float:
    weight = mechanism_of(pendulum, pendulum.name).torque[0]
    return float(0.05 * weight / np.sqrt(pendulum.gravity / 0.2))


def pendulum_xml(pendulum: PendulumFile) -> str:
    """MJCF of a chain of links that hangs, absolute angles from hanging as sensors."""
    bodies, tendons, sensors = "", "", ""
    for i, link in enumerate(pendulum.links, start=1):
        above = pendulum.links[i - 2].length if i > 1 else 0.0
        end = link.length or min(2.0 * link.com, link.com + (3.0 * link.inertia / link.mass) ** 0.5)
        place = f' pos="0 0 {-(above or 0.0)!r}"'
        diagonal = " ".join([repr(link.inertia)] * 3)
        bodies += (
            f'<body name="link_{i}"{place}><joint name="{i}" axis="0 1 0" '
            f'damping="{link.damping!r}"/><inertial pos="0 0 {-link.com!r}" mass="{link.mass!r}" '
            f'diaginertia="{diagonal}"/><geom name="rod_{i}" type="capsule" mass="0" '
            f'fromto="0 0 0 0 0 {-end!r}" size="{RADIUS}" fluidshape="ellipsoid" '
            f'fluidcoef="{DRAG}" contype="0" conaffinity="0"/>'
        )
        joints = "".join(f'<joint joint="{k}" coef="1"/>' for k in range(1, i + 1))
        tendons += f'<fixed name="angle_{i}">{joints}</fixed>'
        sensors += f'<tendonpos name="angle_{i}" tendon="angle_{i}"/>'
    bodies += "</body>" * len(pendulum.links)
    return (
        f'<mujoco model="{pendulum.name}"><compiler angle="radian"/>'
        f'<option gravity="0 0 {-pendulum.gravity!r}" integrator="RK4"/>'
        f"<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon><sensor>{sensors}</sensor>"
        "</mujoco>\n"
    )
