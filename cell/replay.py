"""Decides again what a run decided, from its stored images, and holds both side by side."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibration import load_calibration
from calibration.perception.perception import Perception
from calibration.perception.preflight import inspect
from calibration.perception.sight import Sight
from cell.config.cell import CellFile
from cell.record.columns import Sights
from cell.record.files import CALIBRATION
from cell.record.run import Event, Run, read_run
from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.strip.file import StripFile
from drivers.types import Frame, Pose
from policies.policy import Observation
from policies.registry import make_policy

SAME = 1e-9  # m, rad: what rounding may change, times being shifted by the run's origin


@dataclass(frozen=True, slots=True)
class Replay:
    """How many stored images and decisions were made again, and those that came out otherwise."""

    images: int
    decisions: int
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether everything that could be decided again was decided the same way."""
        return not self.differences and self.decisions > 0


def replay(folder: Path) -> Replay:
    """Read every stored image of the run again and decide again on every sight.

    Raises ConfigurationError for a run that lacks what this needs: one of a laboratory, or one
    that ended before anything was decided.
    """
    run = read_run(folder)
    settings, strip = _recorded(run, "config", CellFile), _recorded(run, "strip_file", StripFile)
    frames = list(run.frames())
    sights = run.sights()
    seen = [*_other_sights(run, settings, strip, frames, sights)]
    decided = [event for event in run.events() if event.kind == "decision"]
    if not decided:
        raise ConfigurationError(f"{folder}: nothing was decided in this run, nothing to replay")
    other = [*_other_decisions(run, settings, strip, decided, sights)]
    images = sum(1 for frame in frames if frame.sequence in set(sights.sequence))
    return Replay(images, len(decided), (*seen, *other))


def _other_sights(
    run: Run, settings: CellFile, strip: StripFile, frames: list[Frame], sights: Sights
) -> Iterator[str]:
    """Images whose sight differs from the recorded one."""
    before = [frame for frame in frames if frame.stamp < 0]
    if not before:
        raise ConfigurationError(f"{run.folder}: the picture before the grasp was not kept")
    calibration = load_calibration(run.folder / CALIBRATION)
    appearance = inspect(before[0], calibration, settings.perception, strip).appearance
    if appearance is None:
        yield "the picture before the grasp shows no strip now"
        return
    perception = Perception(calibration, settings.perception, strip, appearance)
    recorded = {int(sequence): row for row, sequence in enumerate(sights.sequence)}
    for frame in frames:
        if frame.sequence in recorded:
            row = recorded[frame.sequence]
            sight = perception.look(frame, _gripper(run, float(sights.stamp[row])))
            yield from _differences(sight, sights, row)


def _differences(sight: Sight, sights: Sights, row: int) -> Iterator[str]:
    now = {"contact_x": sight.contact_x, "tip_x": sight.tip[0], "tip_z": sight.tip[1]}
    now |= {"gap": sight.gap, "gap_x": sight.gap_x}
    for name, value in now.items():
        then = float(getattr(sights, name)[row])
        if not np.isclose(value, then, rtol=0, atol=SAME, equal_nan=True):
            yield f"image {sight.sequence}: {name} was {then:.6f}, is {value:.6f} m"


def _other_decisions(
    run: Run, settings: CellFile, strip: StripFile, decided: list[Event], sights: Sights
) -> Iterator[str]:
    """Decisions that the policy would now take otherwise."""
    policy = make_policy(str(_fact(run, "policy")))
    policy.reset(strip, settings.fold.speed, 1)
    rows = {int(sequence): row for row, sequence in enumerate(sights.sequence)}
    for event in decided:
        facts = event.facts
        row = rows[int(facts["sequence"])]
        decision = policy.decide(
            Observation(
                time=np.array([facts["time"]]),
                x=np.array([facts["x"]]),
                z=np.array([facts["z"]]),
                stamp=sights.stamp[row : row + 1],
                contact_x=sights.contact_x[row : row + 1],
                tip_x=sights.tip_x[row : row + 1],
                tip_z=sights.tip_z[row : row + 1],
            )
        )
        now, then = float(decision.direction[0]), float(facts["direction"])
        if abs(now - then) > SAME or bool(decision.done[0]) != facts["done"]:
            yield f"image {facts['sequence']}: direction was {then:.6f}, is {now:.6f} rad"


def _gripper(run: Run, stamp: float) -> Pose:
    ticks = run.ticks
    columns = (ticks.x, ticks.z, ticks.pitch)
    return Pose(*(float(np.interp(stamp, ticks.t, column)) for column in columns))


def _recorded(run: Run, key: str, model: type[Any]) -> Any:
    return parse(_fact(run, key), model, f"{run.folder}/run.yaml: {key}")


def _fact(run: Run, key: str) -> Any:
    extra = run.header.model_extra or {}
    if key not in extra:
        raise ConfigurationError(f"{run.folder}/run.yaml: {key}: is missing; not a run of a cell")
    return extra[key]
