"""Times a rendered frame on one core, in ms: `python -m tests.benchmarks.bench_render [frames]`."""

import sys
import time

import cv2
import numpy as np

from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import KNOTS, scene


def main(frames: int) -> None:
    """Print the median and the 95th percentile over `frames` moving frames of each shape."""
    cv2.setNumThreads(1)
    settings = CameraSettings()
    start = time.perf_counter()
    renderer = Renderer(settings, StripLook((40, 60, 110), 0.001, 0.05), seed=0)
    print(f"set-up {1e3 * (time.perf_counter() - start):.0f} ms")
    every = []
    for kind in KNOTS:
        exposure = [scene(kind, shift=(dx, dx / 2)) for dx in (-0.0004, 0.0, 0.0004)]
        took = [_time(renderer, exposure, sequence) for sequence in range(frames)]
        every += took
        print(f"{kind:8s} {np.median(took):5.2f} ms, 95 % {np.percentile(took, 95):5.2f} ms")
    print(f"all      {np.median(every):5.2f} ms")


def _time(renderer: Renderer, exposure: list, sequence: int) -> float:
    start = time.perf_counter()
    renderer.render(exposure, sequence)
    return 1e3 * (time.perf_counter() - start)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
