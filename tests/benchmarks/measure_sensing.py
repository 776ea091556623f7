"""Errors of each channel that a policy reads, measured on the twin's images.

python -m tests.benchmarks.measure_sensing [STRIP...] [--every N]: the plant is the chain, the
calibration is made through its own images; every N-th frame of a triangular fold counts from the
take-over on. Prints noise, bias and outliers of each channel, unseen frames and the error of the
stamps, beside what training assumes (`policies.sensing.IMAGES` and `TRAINING`).
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.perception.measurement import StripMeasurement
from calibration.perception.perception import Perception
from calibration.perception.preflight import inspect
from calibration.perception.settings import PerceptionSettings
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from drivers.strip.shape import fold_tip
from drivers.types import Array, Pose
from policies.path import triangular
from policies.profile import profiles, seen_profile
from policies.sensing import TRAINING
from tests.support.twin_calibration import twin_calibration
from tests.support.twin_fold import CameraSettings, FoldCamera, TwinFold, simulate_fold

STRIPS = Path(__file__).parents[2] / "configs" / "strips"
SPEED = 0.1  # m/s
TAKE_OVER = 0.10  # m of height from which a policy decides
WILD = 5.0  # robust standard deviations from which an error is an outlier
CHANNELS = ("contact_x", "tip_x", "tip_z", "profile_x", "profile_z")


@dataclass(frozen=True)
class Errors:
    """Measured minus true of one strip [m]: `t` (k,) [s], `state` (k, 3) of contact, tip x, tip z,
    `profile` (k, POINTS, 2), `speed` (k,) of the tip's x [m/s]; `unseen` frames of `frames`.
    """

    state: Array
    profile: Array
    speed: Array
    unseen: int
    frames: int

    def channel(self, name: str) -> Array:
        """Errors (k, points) of a channel."""
        if name in CHANNELS[:3]:
            return self.state[:, [CHANNELS.index(name)]]
        return self.profile[:, 1:-1, CHANNELS.index(name) - 3]


def errors(strip: StripFile, every: int) -> Errors:
    """Errors over the frames of one fold, until its layers touch."""
    fold = simulate_fold(strip, triangular(strip.length), SPEED, links=80)
    camera = FoldCamera(strip, CameraSettings())
    perception = _perception(strip, camera)
    rate, rows, unseen = camera.settings.rate, [], 0
    first = float(fold.t[np.argmax(fold.poses[:, 1] >= TAKE_OVER)])
    end = fold.touch.time if fold.touch is not None else float(fold.t[-1])
    frames = range(int(first * rate) + 1, int(end * rate), every)
    for sequence in frames:
        stamp = sequence / rate
        sight = perception.look(camera.frame(fold, sequence), fold.pose(stamp))
        if len(sight.profile) < 2 or not np.isfinite(sight.contact_x):
            unseen += 1
            continue
        rows.append(_row(sight, fold, stamp))
    state, profile, speed = (np.array(part) for part in zip(*rows, strict=True))
    return Errors(state, profile, speed, unseen, len(frames))


def _perception(strip: StripFile, camera: FoldCamera) -> Perception:
    calibration, settings = twin_calibration(CameraSettings()), PerceptionSettings()
    preflight = inspect(camera.flat(strip), calibration, settings, strip)
    assert preflight.appearance is not None
    return Perception(calibration, settings, strip, preflight.appearance)


def _row(sight: StripMeasurement, fold: TwinFold, stamp: float) -> tuple[Array, Array, float]:
    true, grip = fold.shape(stamp), fold.pose(stamp)
    contact, tip = fold.contact_x(stamp), np.array(fold_tip(true))
    later = np.array(fold_tip(fold.shape(stamp + 0.01)))
    seen = np.array([sight.contact_x, *sight.tip])
    curve = seen_profile(sight.profile, sight.contact_x, (grip.x, grip.z))[0]
    straight = profiles(true[None], fold.arc[None], np.array([contact]), _point(grip))
    return seen - [contact, *tip], curve - straight[0], float(later[0] - tip[0]) / 0.01


def _point(pose: Pose) -> Array:
    return np.array([[pose.x, pose.z]])


def spread(values: Array) -> float:
    """Robust standard deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def line(name: str, found: list[Errors]) -> str:
    """Noise within strips, bias between them, and outliers of a channel [mm]."""
    each = [errors_.channel(name) for errors_ in found]
    middle = [np.median(e, axis=0) for e in each]
    off = np.concatenate([(e - m).ravel() for e, m in zip(each, middle, strict=True)])
    sigma = spread(off)
    wild = np.abs(off) > WILD * max(sigma, 1e-5)
    bias = np.sqrt(np.mean(np.square(np.concatenate(middle))))
    return (
        f"{name:10s} noise {1e3 * sigma:6.2f} mm (rms {1e3 * off.std():6.2f})  bias "
        f"{1e3 * bias:6.2f} mm  outliers {100 * wild.mean():5.2f} %  "
        f"worst {1e3 * np.abs(off).max():6.1f} mm"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("strips", nargs="*")
    parser.add_argument("--every", type=int, default=3)
    asked = parser.parse_args()
    names = asked.strips or [path.stem for path in sorted(STRIPS.glob("*.yaml"))]
    found = [errors(load_strip(STRIPS / f"{name}.yaml"), asked.every) for name in names]
    for name in CHANNELS:
        print(line(name, found))
    unseen, frames = sum(e.unseen for e in found), sum(e.frames for e in found)
    speed = np.concatenate([e.speed for e in found])
    late = np.concatenate([e.state[:, 1] for e in found])
    fast = np.abs(speed) > 0.05
    error = float((late[fast] * speed[fast]).sum() / (speed[fast] ** 2).sum()) if fast.any() else 0
    print(f"unseen     {unseen} of {frames} frames; stamps off by {1e3 * error:+.1f} ms")
    print(
        f"training   contact {1e3 * TRAINING.contact_sigma:.2f} mm, bias "
        f"{1e3 * TRAINING.contact_bias:.2f}; tip x {1e3 * TRAINING.tip_sigma:.2f}, bias "
        f"{1e3 * TRAINING.tip_bias:.2f}; profile {1e3 * TRAINING.profile_sigma:.2f}, bias "
        f"{1e3 * TRAINING.profile_bias:.2f}; outliers {100 * TRAINING.wild:.1f} %, dropped up to "
        f"{100 * TRAINING.dropped[1]:.0f} %, stamps {1e3 * TRAINING.delay_error:.0f} ms, all noise "
        f"times {TRAINING.factor[0]:g} to {TRAINING.factor[1]:g}"
    )


if __name__ == "__main__":
    main()
