"""What perception gets wrong alike in all runs: `python -m tests.benchmarks.measure_bias [STRIP]`.

The twin's folds through its images, of the standard motion `normal`: mean over a half of a run of
what images say less what is true, of the profile (normal to the strip) by third of the strip and of
the contact, before and past the middle of the strip, and at the touch. What is printed last, the
root mean square over the strips of each mean, is what the gap workflow takes for an error that is
common to all runs (`BIASES` of `cell.gap.subject.strip.bias`).
"""

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from calibration.calibration import Calibration
from cell.gap.subject.strip.bias import half
from cell.gap.subject.strip.phases import zones
from cell.perception.layer_touch import LayerTouch
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.settings import PerceptionSettings
from cell.studies.kit.twin_fold import CameraSettings, FoldCamera, TwinFold, simulate_fold
from drivers.strip.describe import load_strip
from drivers.types import Array
from policies.experiments.standard import FIRST, STANDARD
from tests.support.twin_calibration import twin_calibration

STRIPS = Path(__file__).parents[2] / "configs" / "strips"
TAKE_OVER = 0.10  # m of height from which a policy decides
EVERY = 5  # images, of which one is looked at until shortly before the touch
NEAR = 0.5  # s before the touch, from which on all are


def signed(points: Array, curve: Array) -> tuple[Array, Array]:
    """Distances (n,) of points (n, 2) from a polyline (m, 2), positive to its left, and where along
    it (n,) the nearest places are, as shares of its segments.
    """
    start, along = curve[:-1], np.diff(curve, axis=0)
    offset = points[:, None] - start[None]
    share = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    gap = offset - share[..., None] * along
    nearest = np.hypot(gap[..., 0], gap[..., 1]).argmin(axis=1)
    rows = np.arange(len(points))
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)[nearest]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    where = (nearest + share[rows, nearest]) / len(along)
    return (gap[rows, nearest] * normal).sum(axis=1), where


def biases(fold: TwinFold, camera: FoldCamera, calibration: Calibration) -> dict[str, float]:
    """Mean errors of a fold's images by quantity, third of the strip and half of the run [m, s]."""
    settings, strip = PerceptionSettings(), fold.strip
    preflight = inspect(camera.flat(strip), calibration, settings, strip)
    if preflight.appearance is None or fold.touch is None:
        return {}
    perception = Perception(calibration, settings, strip, preflight.appearance)
    detector, rate = LayerTouch(settings, strip), camera.settings.rate
    errors: dict[str, list[float]] = defaultdict(list)
    first = float(fold.t[np.argmax(fold.poses[:, 1] >= TAKE_OVER)])
    for sequence in range(int(first * rate) + 1, int(fold.t[-1] * rate)):
        stamp = sequence / rate
        if stamp < fold.touch.time - NEAR and sequence % EVERY:
            continue
        pose = fold.pose(stamp)
        sight = perception.look(camera.frame(fold, sequence), pose)
        touch = detector.tell(sight, pose)
        if touch is not None:
            errors["touch_time"].append(touch.time - fold.touch.time)
            errors["displacement"].append(touch.displacement - fold.touch.displacement)
            break
        side = half(pose.x, strip.length)
        errors[f"contact_x {side}"].append(sight.contact_x - fold.contact_x(stamp))
        if len(sight.profile):
            off, where = signed(sight.profile, fold.shape(stamp))
            labels = zones(where * strip.length, strip.length)
            for zone in np.unique(labels):
                errors[f"profile {zone} {side}"].append(float(np.median(off[labels == zone])))
    return {name: float(np.nanmean(values)) for name, values in errors.items()}


def main(names: list[str]) -> None:
    """One line a strip [mm, ms], then the root mean squares over them."""
    calibration = twin_calibration(CameraSettings())
    found: dict[str, list[float]] = defaultdict(list)
    for name in names or [path.stem for path in sorted(STRIPS.glob("*.yaml"))]:
        strip = load_strip(STRIPS / f"{name}.yaml")
        motion = STANDARD[FIRST]
        fold = simulate_fold(strip, motion.shape(strip.length), motion.speed)
        here = biases(fold, FoldCamera(strip, CameraSettings()), calibration)
        for quantity, value in here.items():
            found[quantity].append(value)
        sys.stdout.write(f"{name:14s} {_row(here)}\n")
        sys.stdout.flush()
    rms = {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in found.items()}
    sys.stdout.write(f"{'rms':14s} {_row(rms)}\n")


def _row(values: dict[str, float]) -> str:
    return "  ".join(f"{name} {1e3 * value:+.2f}" for name, value in sorted(values.items()))


if __name__ == "__main__":
    main(sys.argv[1:])
