"""Replay of a run: perception and decisions repeated on its stored images and
measurements.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from calibration.calibration import Calibration, load_calibration
from cell.base.config.cell import CellFile
from cell.folding.correction import correction_of
from cell.orchestrator.phases import observation
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.strip_measurement import StripMeasurement
from cell.record.events import Event
from cell.record.files import CALIBRATION, CHECKPOINT, EVENTS, TICKS
from cell.record.frames import INDEX, frame_file
from cell.record.run import Run, read_run
from drivers.base.errors import ConfigurationError
from drivers.base.settings import parse
from drivers.base.types import Frame, Pose
from drivers.strip.file import StripFile
from policies.path import FoldLine
from policies.policy import at_line
from policies.registry import make_policy

Measured = dict[int, StripMeasurement]  # by the sequence number of the image
# m, rad: effect of rounding, as times are shifted by the run's origin
POSE_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay: the numbers of images and decisions that were repeated, and a
    text for each difference from the record.
    """

    images: int
    decisions: int
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether all repeated images and decisions equal the recorded ones, and there
        was at least one decision.
        """
        return not self.differences and self.decisions > 0


def replay(folder: Path) -> Replay:
    """Repeat the measurement of every stored image, and every decision, of the run in
    `folder`.

    For a run without images, only the decisions. Raises ConfigurationError for a run
    that lacks the data: a laboratory's run, or one that ended before any decision.
    """
    run = read_run(folder)
    settings = _header_entry(run, "config", CellFile)
    strip = _header_entry(run, "strip_file", StripFile)
    decided = [
        _decision(event, run) for event in run.events() if event.kind == "decision"
    ]
    if not decided:
        raise ConfigurationError(
            f"{folder}: nothing was decided in this run, nothing to replay"
        )
    if run.ticks.t.size == 0:
        raise ConfigurationError(f"{folder}: {TICKS}: holds no row, nothing to replay")
    measured = {seen.sequence: seen for seen in run.measurements()}
    images, in_images = _repeat_perception(run, strip, measured)
    in_decisions = _other_decisions(run, settings, strip, decided, measured)
    return Replay(images, len(decided), (*in_images, *in_decisions))


@dataclass(frozen=True, slots=True)
class _Decision:
    """Recorded decision of a policy, with the number of its image, its time [s] and the
    gripper's position [m].
    """

    sequence: int
    time: float
    x: float
    z: float
    direction: float
    done: bool


_DECISION = TypeAdapter(_Decision)


def _decision(event: Event, run: Run) -> _Decision:
    """Decision that the recorded `event` of `run` holds; ConfigurationError where it is
    not whole.
    """
    try:
        return _DECISION.validate_python(event.facts)
    except ValidationError:
        raise ConfigurationError(
            f"{run.folder / EVENTS}: the decision at {event.t:.2f} s is not whole; "
            "it was changed after the run"
        ) from None


def _repeat_perception(
    run: Run, strip: StripFile, measured: Measured
) -> tuple[int, list[str]]:
    """Measure the stored images of a run again; returns their number, and a text for
    each difference from the record.
    """
    frames = run.frames()
    first = next(frames, None)
    if first is None:
        if run.frame_index():
            return 0, []
        raise ConfigurationError(
            f"{run.folder / INDEX}: lists no image; it belongs to the run"
        )
    if first.stamp >= 0:
        raise ConfigurationError(
            f"{run.folder}: the picture before the grasp was not kept"
        )
    calibration = load_calibration(run.folder / CALIBRATION)
    appearance = inspect(first, calibration, strip).appearance
    if appearance is None:
        return 0, ["the picture before the grasp shows no strip now"]
    perception = Perception(calibration, strip, appearance)
    images = 0
    differences: list[str] = []
    for frame in frames:
        _check_size(run, frame, calibration)
        then = measured.get(frame.sequence)
        if then is not None:
            now = perception.measure(frame, run.ticks.pose_at(then.stamp))
            differences.extend(_differences(now, then))
            images += 1
    return images, differences


def _check_size(run: Run, frame: Frame, calibration: Calibration) -> None:
    """Raise ConfigurationError where the stored image `frame` has another size than the
    images of the `calibration`.
    """
    lens = calibration.lens
    if not lens.fits(frame.image):
        height, width, _ = frame.image.shape
        raise ConfigurationError(
            f"{frame_file(run.folder, frame.sequence)}: is {width} x {height} pixels,"
            f" the calibration is for {lens.width} x {lens.height}; it was changed"
            " after the run"
        )


def _differences(now: StripMeasurement, then: StripMeasurement) -> Iterator[str]:
    """Yield a text for each length that is measured differently `now` from what it was
    `then`.
    """
    recorded = _lengths(then)
    for name, value in _lengths(now).items():
        if not np.isclose(
            value, recorded[name], rtol=0, atol=POSE_ROUNDING, equal_nan=True
        ):
            yield (
                f"image {now.sequence}: {name} was {recorded[name]:.6f}, is"
                f" {value:.6f} m"
            )


def _lengths(seen: StripMeasurement) -> dict[str, float]:
    """Lengths [m] that were measured in an image, by the name of their column in the
    record.
    """
    names = ("contact_x", "tip_x", "tip_z", "gap", "gap_x")
    return dict(
        zip(names, (seen.contact_x, *seen.tip, seen.gap, seen.gap_x), strict=True)
    )


def _other_decisions(
    run: Run,
    settings: CellFile,
    strip: StripFile,
    decided: list[_Decision],
    measured: Measured,
) -> Iterator[str]:
    """Decide again on the recorded measurements of a run, and yield a text for each
    decision that differs from the record.
    """
    header = run.header
    weights = None if header.checkpoint is None else run.folder / CHECKPOINT
    made = make_policy(str(_header_value(run, "policy")), weights)
    correction_of(header.learning).apply(made)
    policy = at_line(made, FoldLine.of(strip.length, header.line))
    policy.reset(strip, settings.fold.speed, 1)
    for then in decided:
        seen = measured.get(then.sequence)
        if seen is None:
            yield (
                f"image {then.sequence}: was decided on, but its sight is not in the"
                " record"
            )
            continue
        held = run.ticks.pose_at(seen.stamp)
        seen = replace(seen, gripper=(held.x, held.z))
        decision = policy.decide(
            observation(then.time, Pose(then.x, then.z, 0.0), seen)
        )
        now = float(decision.direction[0])
        if (
            not abs(now - then.direction) <= POSE_ROUNDING
            or bool(decision.done[0]) != then.done
        ):
            yield (
                f"image {then.sequence}: direction was {then.direction:.6f}, is"
                f" {now:.6f} rad"
            )


def _header_entry(run: Run, key: str, model: type[Any]) -> Any:
    """Entry `key` of the header of a run, parsed as an object of the class `model`;
    ConfigurationError where it is missing or not valid.
    """
    return parse(
        _header_value(run, key), model, f"{run.folder}/run.yaml: {key}", extra="ignore"
    )


def _header_value(run: Run, key: str) -> Any:
    """Value of the entry `key` in the header of a run; ConfigurationError where it is
    missing.
    """
    fact = getattr(run.header, key)
    if fact is None:
        raise ConfigurationError(
            f"{run.folder}/run.yaml: {key}: is missing; not a run of a cell"
        )
    return fact
