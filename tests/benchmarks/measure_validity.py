"""Where rod and chain can be believed: folds of strips ever further from ordinary fabric.

`python -m tests.benchmarks.measure_validity [KEY ...]` folds by the triangle, changing one value
of denim at a time, on each engine as it is used and with half its step in space. The table says
what d each found [mm], how far the finer one is from it, or why there is none. The bounds in
`drivers/strip/validity.py` are read off it.
"""

import argparse
import sys
import time

import numpy as np

from cell.config.places import find_configs
from drivers.errors import CellError
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out

SWEEPS = {
    "bending_length": (
        0.002,
        0.004,
        0.006,
        0.008,
        0.010,
        0.0135,
        0.033,
        0.045,
        0.06,
        0.08,
        0.1,
        0.2,
    ),
    "length": (0.1, 0.15, 0.2, 0.3, 0.45, 0.9, 1.2, 2.0),
    "width": (0.002, 0.01, 0.2, 1.0),
    "thickness": (1e-5, 1e-4, 0.004, 0.008, 0.02),
    "areal_density": (0.001, 0.01, 0.05, 2.0, 10.0, 50.0),
    "retardation_time": (0.0, 1e-3, 4e-3, 0.2, 1.0, 3.0, 10.0),
}
ENGINES = {
    "rod": (lambda: Rod(100), lambda: Rod(200)),
    "chain": (lambda: Chain(80), lambda: Chain(160)),
}


def folded(engine: Stepper, strip: StripFile) -> float | str:
    """d [m] of a fold by the triangle, or what came instead of it."""
    policy = make_policy("triangular")
    rng = np.random.default_rng(0)
    try:
        ended = roll_out(
            policy, engine, strip, [describe(strip)], settings=Rollout(substeps=4), rng=rng
        )
    except CellError as error:
        return str(error).partition(":")[0]
    return float(ended.displacement[0]) if ended.touched[0] else "no touch"


def line(key: str, value: float, strip: StripFile) -> str:
    """A row of the table."""
    cells = []
    for coarse, fine in ENGINES.values():
        began = time.process_time()
        found = [folded(make(), strip) for make in (coarse, fine)]
        cells.append(f"{_shown(found[0]):>26} {_apart(*found):>10}")
        cells.append(f"{time.process_time() - began:4.0f} s")
    return f"{key:17s} {value:8g}  " + "  ".join(cells)


def _shown(found: float | str) -> str:
    return found if isinstance(found, str) else f"{1e3 * found:+.1f}"


def _apart(coarse: float | str, fine: float | str) -> str:
    if isinstance(coarse, str) or isinstance(fine, str):
        return _shown(fine)[:10] if isinstance(fine, str) else ""
    return f"{1e3 * (fine - coarse):+.1f}"


def main() -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("keys", nargs="*", help=f"of {', '.join(SWEEPS)}")
    keys = parser.parse_args().keys or list(SWEEPS)
    plain = find_configs(None).strip("denim")
    sys.stdout.write(f"{'':27s} {'rod: d mm':>26} {'finer by':>10} {'':7s} {'chain: d mm':>26}\n")
    for key in keys:
        for value in SWEEPS[key]:
            strip = plain.model_copy(update={key: value})
            sys.stdout.write(line(key, value, strip) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
