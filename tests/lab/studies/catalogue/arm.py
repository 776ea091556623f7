"""Study of faults hidden in the cell's arm, found from the paths of folds through its
library.

Each fault in turn is hidden in a served robot, which the client library drives in
lock-step along FOLDS paths of a fold, in the air; what `cell fold --arm fci` would have
kept of its joints is fitted. Links are 1 % heavier or lighter than the model, by
chance.
"""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from cell.base.config.places import CHECKOUT_CONFIGS, find_configs
from cell.base.devices.fci import fci_arm, start_joints
from cell.base.devices.fold_path import triangle, whole_path
from cell.gap.fit import fit
from cell.record.files import JOINTS, RUN
from cell.record.tables import joint_table, write_parquet
from drivers.base.geometry import interpolate_columns
from drivers.base.readers import read_yaml
from drivers.base.types import Array, Velocity, frozen
from drivers.franka.model import ArmPlant
from drivers.franka.reach import densify
from drivers.twin.clock import TwinClock
from drivers.twin.fci_server.server import RobotServer, ServerSettings
from tests.lab.studies.catalogue import mechanisms
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage

ARM = CHECKOUT_CONFIGS / "mechanisms" / "arm" / "mechanism.yaml"
FOLDS = ((0.60, 0.16), (0.45, 0.12), (0.52, 0.19))
STEP, GAIN, RAISED = 0.02, 3.0, 0.1  # s, 1/s, m
FAULTS: Mapping[str, Mapping[str, Any]] = read_yaml(Path(__file__).with_suffix(".yaml"))


def drive(plant: ArmPlant, length: float, speed: float) -> Array:
    """Ticks of the joints (n, 29) along the path of a fold of a strip of `length` [m]
    in the air, lifted by RAISED, at `speed` [m/s].
    """
    settings = find_configs(None).cell()
    patient = settings.fci.model_copy(update={"start": 60.0, "answer": 60.0})
    settings = settings.model_copy(update={"fci": patient})
    installation = settings.fci.limit(settings.installation)
    plan = settings.fold.model_copy(update={"speed": speed, "lay_speed": speed})
    path, speeds = whole_path(length, installation, plan, triangle(length))
    path[1:, 1] += RAISED
    poses, times = densify(path, np.minimum(speeds, speed))
    due = 1.5 * np.concatenate([[0.0], np.cumsum(times[1:])])
    start = start_joints(installation, settings.fold, length)
    clock = TwinClock()
    with RobotServer(ServerSettings(plant=plant), start=frozen(start)) as server:
        arm, _ = fci_arm(settings, clock, server.address)
        arm.connect()
        try:
            for k in range(int((due[-1] + 0.5) / STEP)):
                here, soon = (
                    interpolate_columns((k + i) * STEP, due, poses) for i in range(2)
                )
                away = here - arm.state().commanded.as_array()
                most = [axis.velocity for axis in installation.limits.axes]
                rate = np.clip(
                    (soon - here) / STEP + GAIN * away, np.negative(most), most
                )
                arm.set_velocity(Velocity(*rate.tolist()))
                clock.wait_until((k + 1) * STEP)
        finally:
            arm.close()
        return arm.joints


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


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all faults, then through arms."""
    arm, fault = divmod(number, len(FAULTS))
    return {"hidden": list(FAULTS)[fault], "noise": arm}


def measure(case: Values) -> Values:
    """Score the verdict on a case, beside the effects that it names and its processor
    time [s].
    """
    hidden = case["hidden"]
    with TemporaryDirectory() as place:
        make(
            Path(place) / "runs",
            hidden,
            10 * case["noise"] + list(FAULTS).index(hidden),
        )
        began = time.process_time()
        verdict = fit([Path(place) / "runs"], ARM, Path(place) / "verdict")
        cpu = time.process_time() - began
    kind, causes = ("nothing", []) if hidden == "nothing" else ("one effect", [hidden])
    return {
        **mechanisms.score(kind, causes, verdict),
        "cpu": cpu,
        "verdict": json.loads(verdict.to_json()),
    }


STUDY = Study(
    name="arm",
    question="Which faults hidden in the cell's arm does `cell gap` name?",
    draw=draw,
    measure=measure,
    by=("hidden",),
    quantities=(
        percentage("by_class", "right by class"),
        percentage("false", "named falsely"),
        Quantity("cpu", Statistic.MEDIAN, "s", 1.0, label="fit, median", digits=0),
    ),
    usual=len(FAULTS),
    quick=0,
    seconds=300.0,
)
