"""What a turn of the control loop costs, and a fold as a whole, on the twin through images.

python -m tests.benchmarks.bench_tick [STRIP] [POLICY]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from cell.devices.devices import DeviceSelection
from cell.operations.fold import Request, fold
from cell.record.run import read_run


def main() -> None:
    words = [*sys.argv[1:], "denim", "feedback"]
    strip, policy = words[0], words[1] if len(sys.argv) > 2 else "feedback"
    with tempfile.TemporaryDirectory() as runs:
        request = Request(
            strip, policy, None, DeviceSelection(), Path(runs), None, None, True, "off"
        )
        fold(request)  # compiles and warms
        result = fold(request)
        run = read_run(Path(result.run))
        cost = 1e3 * run.costs()
        news = np.diff(run.ticks.image_age, prepend=0.0) < 0
    print(f"control tick: median {np.median(cost):.2f} ms, 95 % {np.quantile(cost, 0.95):.2f} ms")
    print(
        f"  with a new image, rendered and read: median {np.median(cost[: len(news)][news]):.2f} ms"
    )
    print(
        f"fold: {result.wall:.1f} s of wall for {result.duration:.1f} s of the cell's time, "
        f"ratio {result.wall / result.duration:.2f}"
    )


if __name__ == "__main__":
    main()
