"""Repeats perception and decisions of a run on its stored images, and compares the results."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from calibration.calibration import Calibration, load_calibration
from cell.config.cell import CellFile
from cell.learning.correction import correction_of
from cell.perception.measurement import StripMeasurement
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.record.columns import Sights
from cell.record.events import Event
from cell.record.files import CALIBRATION, CHECKPOINT, EVENTS, TICKS
from cell.record.frames import INDEX, frame_file
from cell.record.run import Run, read_run
from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.strip.file import StripFile
from drivers.types import Array, Frame
from policies.policy import Observation
from policies.profile import seen_profile
from policies.registry import make_policy

NO_PROFILE: Array = np.empty((0, 2))
POSE_ROUNDING = 1e-9  # m, rad: effect of rounding, as times are shifted by the run's origin


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay: counts of repeated images and decisions, and their differences."""

    images: int
    decisions: int
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether everything that could be repeated gave the same result."""
        return not self.differences and self.decisions > 0


def replay(folder: Path) -> Replay:
    """Repeat perception on every stored image and decide again on every measurement.

    For a run without images, only the decisions. Raises ConfigurationError for a run that lacks the
    data: a laboratory's run, or one that ended before any decision.
    """
    run = read_run(folder)
    settings = _header_entry(run, "config", CellFile)
    strip = _header_entry(run, "strip_file", StripFile)
    decided = [_Decision.read(event, run) for event in run.events() if event.kind == "decision"]
    if not decided:
        raise ConfigurationError(f"{folder}: nothing was decided in this run, nothing to replay")
    if run.ticks.t.size == 0:
        raise ConfigurationError(f"{run.folder}: {TICKS}: holds no row, nothing to replay")
    sights = run.sights()
    images, seen = _repeat_perception(run, settings, strip, sights)
    other = [*_other_decisions(run, settings, strip, decided, sights)]
    return Replay(images, len(decided), (*seen, *other))


@dataclass(frozen=True, slots=True)
class _Decision:
    """A recorded decision with its image, gripper position [m] and time [s]."""

    sequence: int
    time: float
    x: float
    z: float
    direction: float
    done: bool

    @classmethod
    def read(cls, event: Event, run: Run) -> Self:
        try:
            facts = {field.name: event.facts[field.name] for field in fields(cls)}
            numbers = {name: float(facts[name]) for name in ("time", "x", "z", "direction")}
            return cls(sequence=int(facts["sequence"]), done=bool(facts["done"]), **numbers)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise ConfigurationError(
                f"{run.folder / EVENTS}: the decision at {event.t:.2f} s is not whole; "
                "it was changed after the run"
            ) from None


def _repeat_perception(
    run: Run, settings: CellFile, strip: StripFile, sights: Sights
) -> tuple[int, list[str]]:
    """Measure the stored images again; returns their number, and differences from the record."""
    frames = run.frames()
    before = next(frames, None)
    if before is None and run.frame_index():
        return 0, []
    if before is None:
        raise ConfigurationError(f"{run.folder / INDEX}: lists no image; it belongs to the run")
    if before.stamp >= 0:
        raise ConfigurationError(f"{run.folder}: the picture before the grasp was not kept")
    calibration = load_calibration(run.folder / CALIBRATION)
    appearance = inspect(before, calibration, settings.perception, strip).appearance
    if appearance is None:
        return 0, ["the picture before the grasp shows no strip now"]
    perception = Perception(calibration, settings.perception, strip, appearance)
    recorded = {int(sequence): row for row, sequence in enumerate(sights.sequence)}
    images, differences = 0, list[str]()
    for frame in frames:
        _check_size(run, frame, calibration)
        row = recorded.get(frame.sequence)
        if row is not None:
            measurement = perception.look(frame, run.ticks.pose_at(float(sights.stamp[row])))
            differences.extend(_differences(measurement, sights, row))
            images += 1
    return images, differences


def _check_size(run: Run, frame: Frame, calibration: Calibration) -> None:
    found, lens = frame.image.shape, calibration.lens
    if found[:2] != (lens.height, lens.width):
        raise ConfigurationError(
            f"{frame_file(run.folder, frame.sequence)}: is {found[1]} x {found[0]} pixels, the "
            f"calibration is for {lens.width} x {lens.height}; it was changed after the run"
        )


def _differences(measurement: StripMeasurement, sights: Sights, row: int) -> Iterator[str]:
    now = {"contact_x": measurement.contact_x}
    now |= {"tip_x": measurement.tip[0], "tip_z": measurement.tip[1]}
    now |= {"gap": measurement.gap, "gap_x": measurement.gap_x}
    for name, value in now.items():
        then = float(getattr(sights, name)[row])
        if not np.isclose(value, then, rtol=0, atol=POSE_ROUNDING, equal_nan=True):
            yield f"image {measurement.sequence}: {name} was {then:.6f}, is {value:.6f} m"


def _other_decisions(
    run: Run, settings: CellFile, strip: StripFile, decided: list[_Decision], sights: Sights
) -> Iterator[str]:
    """Decide again on the recorded measurements; yields decisions that differ from the record."""
    policy = make_policy(str(_header_value(run, "policy")), _checkpoint(run))
    correction_of(run.header.learning).apply(policy)
    policy.reset(strip, settings.fold.speed, 1)
    rows = {int(sequence): row for row, sequence in enumerate(sights.sequence)}
    curves = dict(run.profile.curves())
    for then in decided:
        row = rows.get(then.sequence)
        if row is None:
            yield f"image {then.sequence}: was decided on, but its sight is not in the record"
            continue
        decision = policy.decide(_observe(then, run, sights, row, curves))
        now = float(decision.direction[0])
        if not abs(now - then.direction) <= POSE_ROUNDING or bool(decision.done[0]) != then.done:
            yield f"image {then.sequence}: direction was {then.direction:.6f}, is {now:.6f} rad"


def _observe(
    then: _Decision, run: Run, sights: Sights, row: int, curves: dict[float, Array]
) -> Observation:
    """Observation for the policy: the recorded measurement in `row`, the gripper as measured."""
    stamp = float(sights.stamp[row])
    gripper = run.ticks.pose_at(stamp)
    return Observation(
        time=np.array([then.time]),
        x=np.array([then.x]),
        z=np.array([then.z]),
        stamp=sights.stamp[row : row + 1],
        contact_x=sights.contact_x[row : row + 1],
        tip_x=sights.tip_x[row : row + 1],
        tip_z=sights.tip_z[row : row + 1],
        profile=seen_profile(
            curves.get(stamp, NO_PROFILE), float(sights.contact_x[row]), (gripper.x, gripper.z)
        ),
        profile_confidence=sights.profile_confidence[row : row + 1],
    )


def _checkpoint(run: Run) -> Path | None:
    """Checkpoint of this run; None where it used the committed weights."""
    if run.header.checkpoint is None:
        return None
    return run.folder / CHECKPOINT


def _header_entry(run: Run, key: str, model: type[Any]) -> Any:
    return parse(_header_value(run, key), model, f"{run.folder}/run.yaml: {key}")


def _header_value(run: Run, key: str) -> Any:
    fact = getattr(run.header, key)
    if fact is None:
        raise ConfigurationError(f"{run.folder}/run.yaml: {key}: is missing; not a run of a cell")
    return fact
