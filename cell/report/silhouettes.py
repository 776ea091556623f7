"""Outlines of the strip in the kept images after the layers touch, when no profile is measured."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.settings import PerceptionSettings
from cell.record.frames import read_frame
from cell.record.run import Run
from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.strip.file import StripFile
from drivers.types import Array, Frame, Pose

SILHOUETTE_STATES = ("LAY", "RELEASE")
MOST_IMAGES = 6


@dataclass(frozen=True, slots=True)
class Silhouette:
    """Outline in image `sequence`, in `state`: `pixels` (n, 2) [px], `plane` (n, 2) x, z [m]."""

    sequence: int
    state: str
    pixels: Array
    plane: Array


def silhouettes(run: Run) -> tuple[Silhouette, ...]:
    """Outlines of the strip in up to MOST_IMAGES kept images of LAY and RELEASE, in order of time.

    Empty where the picture before the grasp, calibration, strip or ticks are not in the record.
    """
    try:
        return tuple(_outlines(run))
    except ConfigurationError:  # an image or a setting that was changed: the page goes without
        return ()


def _outlines(run: Run) -> Iterator[Silhouette]:
    kept = [note for note in run.frame_index() if note.file is not None]
    laying = [note for note in kept if state_at(run, note.stamp) in SILHOUETTE_STATES]
    flat = next((note for note in kept if note.stamp < 0), None)
    before = None if flat is None else read_frame(flat)
    calibration = run.calibration()
    if not laying or before is None or calibration is None or run.header.strip_file is None:
        return
    strip = parse(run.header.strip_file, StripFile, "run.yaml: strip_file")
    stated = (run.header.config or {}).get("perception", {})
    settings = parse(stated, PerceptionSettings, "run.yaml: config: perception")
    appearance = inspect(before, calibration, settings, strip).appearance
    if appearance is None:
        return
    perception = Perception(calibration, settings, strip, appearance)
    chosen = np.unique(np.linspace(0, len(laying) - 1, MOST_IMAGES).round().astype(int))
    for frame in filter(None, (read_frame(laying[i]) for i in chosen)):
        pixels = perception.outline(frame, _gripper(run, frame))
        if len(pixels):
            state = state_at(run, frame.stamp)
            yield Silhouette(frame.sequence, state, pixels, calibration.to_plane(pixels))


def _gripper(run: Run, frame: Frame) -> Pose:
    ticks = run.ticks
    at = (float(np.interp(frame.stamp, ticks.t, c)) for c in (ticks.x, ticks.z, ticks.pitch))
    return Pose(*at)


def state_at(run: Run, stamp: float) -> str:
    """State of the run at `stamp` [s], empty before the lift and without states."""
    if stamp < 0 or not run.ticks.state:
        return ""
    place = int(np.searchsorted(run.ticks.t, stamp))
    return run.ticks.state[min(place, len(run.ticks.state) - 1)]
