"""Drives the model of a strip with the measured gripper path of a run."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cell.config.cell import CellFile
from cell.record.run import Run, read_run
from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.strip.describe import describe
from drivers.strip.engine import StripMotion, simulate
from drivers.strip.file import StripFile
from drivers.strip.model import Observation, Rig, StripModel
from drivers.strip.rod.engine import Rod

STEP = 0.005  # s
SEGMENTS = 100


@dataclass(frozen=True, slots=True)
class Resimulation:
    """Displacement [m] by the camera and by the rod; None without a touch."""

    measured: float | None
    simulated: float | None
    motion: StripMotion

    @property
    def difference(self) -> float | None:
        """Simulated minus measured [m]."""
        if self.measured is None or self.simulated is None:
            return None
        return self.simulated - self.measured


def resimulate(folder: Path) -> Resimulation:
    """Drive the rod with the run's measured poses; the strip is the one the controller knew.

    Raises ConfigurationError for a run without ticks or without its strip.
    """
    run = read_run(folder)
    ticks = run.ticks
    if len(ticks.t) < 2:
        raise ConfigurationError(f"{folder}: ticks.parquet: holds no motion to simulate")
    poses = np.stack([ticks.x, ticks.z, ticks.pitch], axis=1)
    motion = simulate(Rod(SEGMENTS), _model(run), ticks.t, poses, dt=STEP, shapes=False)
    measured = None if run.result is None else run.result.displacement
    simulated = None if motion.touch is None else motion.touch.displacement
    return Resimulation(measured, simulated, motion)


def _model(run: Run) -> StripModel:
    """Strip model of a run as its record shows it, without the rig's compensated effects."""
    config = run.header.config
    if config is None:
        return describe(_strip(run))
    settings = parse(config, CellFile, f"{run.folder}/run.yaml: config")
    return replace(describe(_strip(run), settings.effects), rig=Rig(), observation=Observation())


def _strip(run: Run) -> StripFile:
    content = run.header.strip_file
    if content is None:
        raise ConfigurationError(f"{run.folder}/run.yaml: strip_file: is missing; add it")
    return parse(content, StripFile, f"{run.folder}/run.yaml: strip_file")
