"""What perception costs and how well it agrees with the truth in any look, of denim or others.

python -m tests.benchmarks.bench_perception [LOOK...] [--strip denim] [--noise 8] [--rounds 5]

Aim on an idle core of 2.5 GHz: at most 4 ms a frame in the median and 6 ms at 99 % in every look
(all of them where none is named), 8 ms where the sensor's noise is 8 grey levels. One thread, its
own time; the frames of a whole fold at 10 Hz. On a loaded machine compare with the reference, a
fixed piece of work that is timed between the frames.
"""

import argparse
import time

import cv2
import numpy as np

from cell.perception.layer_touch import LayerTouch
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.settings import PerceptionSettings
from cell.studies.kit.twin_fold import TwinFold, simulate_fold
from drivers.strip.describe import load_strip
from drivers.twin.renderer.looks import looks
from drivers.twin.settings import CameraSettings
from drivers.types import Frame, Pose
from policies.path import triangular
from tests.support.look_camera import LookCamera
from tests.support.seen_folds import SPEED, STRIPS, agreement, rms
from tests.support.twin_calibration import twin_calibration

Seen = list[tuple[Frame, Pose]]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("looks", nargs="*", metavar="LOOK")
    parser.add_argument("--strip", default="denim")
    parser.add_argument("--noise", type=float, default=CameraSettings().noise)
    parser.add_argument("--rounds", type=int, default=5)
    return parser.parse_args()


def reader(fold: TwinFold, camera: LookCamera) -> tuple[Perception, Seen] | None:
    """Perception of `fold` before a camera, and the frames; None where preflight refuses."""
    calibration, settings = twin_calibration(CameraSettings()), PerceptionSettings()
    rate = camera.settings.rate
    judged = inspect(camera.flat(fold.strip), calibration, settings, fold.strip)
    if judged.appearance is None or not judged.passed:
        return None
    sequences = range(6, int(fold.t[-1] * rate), 6)
    frames = [(camera.frame(fold, k), fold.pose(k / rate)) for k in sequences]
    return Perception(calibration, settings, fold.strip, judged.appearance), frames


def reference() -> float:
    """Processor time of a fixed piece of work [ms]."""
    image = np.full((720, 1280), 90, np.uint8)
    start = time.thread_time()
    for _ in range(4):
        cv2.GaussianBlur(image, (3, 3), 0)
        np.sqrt(np.arange(40000.0)).sum()
    return 1e3 * (time.thread_time() - start)


def bench(perception: Perception, frames: Seen, fold: TwinFold, rounds: int) -> str:
    """Median, 99th percentile and worst time a frame, the reference beside."""
    perception.look(*frames[0])
    taken, compared = [], []
    for _ in range(rounds):
        touch = LayerTouch(PerceptionSettings(), fold.strip)
        for frame, pose in frames:
            compared.append(reference())
            start = time.thread_time()
            touch.tell(perception.look(frame, pose), pose)
            taken.append(1e3 * (time.thread_time() - start))
    return (
        f"median {np.median(taken):5.2f} ms, 99 % {np.percentile(taken, 99):5.2f} ms, "
        f"worst {max(taken):5.2f} ms over {len(taken)} frames; "
        f"reference {np.median(compared):.2f} ms"
    )


def agrees(fold: TwinFold, camera: LookCamera) -> str:
    """Errors of contact, profile and displacement against the truth."""
    found = agreement(fold, camera, twin_calibration(CameraSettings()), every=12)
    d = "touch not seen" if found.touch is None else f"d off by {1e3 * found.displacement:+.2f} mm"
    contact = 1e3 * np.array([np.nanmean(found.contact), rms(found.contact)])
    profile = 1e3 * np.array([rms(found.profile), np.nanmax(found.profile)])
    return (
        f"contact mean {contact[0]:+.2f}, rms {contact[1]:.2f}; profile rms {profile[0]:.2f}, "
        f"worst {profile[1]:.2f} mm; {d}"
    )


def main() -> None:
    """Two lines a look."""
    asked = arguments()
    cv2.setNumThreads(1)
    strip = load_strip(STRIPS / f"{asked.strip}.yaml")
    fold = simulate_fold(strip, triangular(strip.length), SPEED)
    settings = CameraSettings(noise=asked.noise)
    for look in asked.looks or looks():
        camera = LookCamera(strip, looks()[look], settings)
        found = reader(fold, camera)
        if found is None:
            print(f"{look:13s} refused by preflight", flush=True)
            continue
        print(f"{look:13s} {bench(*found, fold, asked.rounds)}", flush=True)
        print(f"{'':13s} {agrees(fold, camera)}", flush=True)


if __name__ == "__main__":
    main()
