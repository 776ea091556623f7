"""Median time that perception takes a frame: `python -m tests.benchmarks.bench_perception [LOOK]`.

Aim: at most 3 ms a frame in the plain look, three times that where the scene is learnt. One
thread, its own time; the frames of a whole fold of denim at 10 Hz.
"""

import sys
import time

import cv2
import numpy as np

from calibration.perception.layer_touch import LayerTouch
from calibration.perception.perception import Perception
from calibration.perception.preflight import inspect
from calibration.perception.settings import PerceptionSettings
from drivers.strip.describe import load_strip
from drivers.twin.renderer.looks import PLAIN, looks
from drivers.twin.settings import CameraSettings
from policies.path import triangular
from tests.benchmarks.measure_perception import SPEED, STRIPS
from tests.support.look_camera import LookCamera
from tests.support.twin_calibration import twin_calibration
from tests.support.twin_fold import simulate_fold

ROUNDS = 5


def main(look: str) -> None:
    """Prints median, 95th percentile and worst [ms]."""
    cv2.setNumThreads(1)
    camera_settings, settings = CameraSettings(), PerceptionSettings()
    strip = load_strip(STRIPS / "denim.yaml")
    fold = simulate_fold(strip, triangular(strip.length), SPEED)
    camera = LookCamera(strip, looks()[look], camera_settings)
    calibration = twin_calibration(camera_settings)
    judged = inspect(camera.waiting(strip), calibration, settings, strip)
    if judged.appearance is None:
        raise SystemExit("the flat strip was not recognised")
    perception = Perception(calibration, settings, strip, judged.appearance)
    sequences = range(6, int(fold.t[-1] * camera_settings.rate), 6)
    frames = [(camera.frame(fold, k), fold.pose(k / camera_settings.rate)) for k in sequences]
    taken = []
    for _ in range(ROUNDS):
        touch = LayerTouch(settings, strip)
        for frame, pose in frames:
            start = time.thread_time()
            touch.tell(perception.look(frame, pose), pose)
            taken.append(1e3 * (time.thread_time() - start))
    middle, most = np.median(taken), np.percentile(taken, 95)
    print(
        f"perception, {look}: median {middle:.2f} ms, 95 % {most:.2f} ms, "
        f"worst {max(taken):.2f} ms over {len(taken)} frames"
    )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else PLAIN)
