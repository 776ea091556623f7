"""The page on a robot of one's own, from a LeRobot set to a named cause, by its text.

    python .ci/judges/own_robot.py make FOLDER
    python .ci/judges/own_robot.py follow FOLDER

`make` writes to FOLDER the model `arm.xml` and `episodes.npz`, motions of an arm whose
joints rub as its model does not say; `follow` takes the commands of the page, with
LeRobot's own set of these episodes in `FOLDER/set`.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
from wanting import require

from cell.gap.subject.run_table import read_table
from tests.support.mechanisms import ARM, PRESCRIBED, make_arm

PAGE = Path("runbooks/identify-a-robot.md")
FRICTION = 0.25, 0.15  # N m, at shoulder and elbow
TORQUE_CONSTANT = 0.31  # N m/A
EVERY = 4  # rows of the motion between two frames


def rub(plant: mujoco.MjModel) -> None:
    """Hide dry friction that holds the joints."""
    plant.dof_frictionloss[:] = FRICTION
    plant.dof_solimp[:, :2] = 0.9999


def make(folder: Path) -> None:
    """Six motions: angles [deg] and currents [A] of both joints, (n, 4) each."""
    _, runs = make_arm(folder / "hidden", 6, rub, PRESCRIBED)
    episodes = []
    for run in sorted(runs.iterdir()):
        motion = read_table(run / "signals.parquet")
        angles = [np.degrees(motion[name]) for name in ("shoulder", "elbow")]
        currents = [motion[name] / TORQUE_CONSTANT for name in ("t1", "t2")]
        episodes.append(np.column_stack([*angles, *currents])[::EVERY])
    np.savez(folder / "episodes.npz", *episodes)
    (folder / "arm.xml").write_text(ARM)


def _run(line: str, folder: Path) -> str:
    """What a command of the page prints in `folder`."""
    words = [Path(sys.executable).with_name("cell"), *line.split()[1:]]
    done = subprocess.run(  # noqa: S603
        words, cwd=folder, capture_output=True, text=True, check=False
    )
    require(done.returncode == 0, f"{line}: {done.stderr}")
    return done.stdout


def follow(folder: Path) -> None:
    """The page's commands run, with its one number: they name what was hidden."""
    _, _, text = PAGE.read_text().partition("## Ten minutes with a LeRobot set")
    guess, commands, *_ = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    _run(guess, folder)
    mapping = folder / "mapping.yaml"
    open_ones = mapping.read_text().count("factor: null")
    require(open_ones == 2, f"two open factors, not {open_ones}")
    mapping.write_text(mapping.read_text().replace("null", str(TORQUE_CONSTANT)))
    said = "".join(_run(line, folder) for line in commands.splitlines())

    require("takes it back" in said, "the way back after an acceptance")
    verdict = json.loads((folder / "out/verdict.json").read_text())
    names = [effect["name"] for effect in verdict["effects"]]
    require(names == ["dry_friction"], f"dry friction by name, not {names}")
    model = mujoco.MjModel.from_xml_path(str(folder / "models/arm-accepted.xml"))
    off = np.abs(model.dof_frictionloss / FRICTION - 1.0).max()
    require(off < 0.15, f"friction within 15 %, not {off:.0%}")
    print(re.search("(?m)^  dry_friction.*$", said)[0].strip())


{"make": make, "follow": follow}[sys.argv[1]](Path(sys.argv[2]))
