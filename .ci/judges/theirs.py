"""What the other programs wrote, in ours: the path that they were given comes back.

python .ci/judges/theirs.py OURS
"""

import sys
from pathlib import Path

import numpy as np
from wanting import require

from cell.gap.subject.mechanism.model_source import compile_model, read_source
from cell.record.exchange.import_runs import import_runs
from cell.record.run import read_run
from drivers.base.yaml_text import dump_yaml

OURS = Path(sys.argv[1])
PLACES = {  # file and columns of t, x and z
    "bag": ("/tip", "header.stamp", "position.along", "position.up"),
    "lerobot": (
        "episode",
        "timestamp",
        "observation.state.along.pos",
        "observation.state.up.pos",
    ),
}


def imported(place: str) -> list[Path]:
    """Runs that are imported from a `place`."""
    file, *names = PLACES[place]
    columns = {
        quantity: {"column": name, "unit": unit}
        for quantity, name, unit in zip("txz", names, "smm", strict=True)
    }
    ticks = {"file": file, "columns": columns}
    mapping = OURS / f"{place}.yaml"
    content = {"schema": 1, "strip": "denim", "sigma": {"gripper": 1e-4}}
    mapping.write_text(dump_yaml(content | {"ticks": ticks}))
    return [*import_runs([OURS / place], mapping, OURS / f"{place}-runs")]


path = np.load(OURS / "path.npy")
for place, count in (("bag", 1), ("lerobot", 2)):
    if not (OURS / place).exists():  # its program is missing
        continue
    runs = imported(place)
    require(len(runs) == count, f"{count} runs, not {len(runs)}")
    for run in runs:
        ticks = read_run(run).ticks
        off = np.abs(np.subtract([ticks.t, ticks.x, ticks.z], path)).max(axis=1)
        print(f"{place}: {len(ticks.t)} rows, off by {off.max():.1e} at most")
        allowed = 0.006 if place == "lerobot" else 1e-6  # its clock: frames
        require(off.max() < allowed, f"rows within {allowed}")
saved = OURS / "saved.xml"
if saved.exists():
    model = compile_model(read_source(saved, OURS), str(saved), 0, 0.002)
    print(f"saved.xml: {model.njnt} joints")
