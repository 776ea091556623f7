"""How far apart two engines are in a base: `python -m tests.benchmarks.measure_damping`.

python -m tests.benchmarks.measure_damping [STRIP ...] [--step 0.004]

The standard runs in a chain of 200 links, read without noise, and the base that the workflow fits
to them in the rod: by how much its bending length and retardation time differ from those of the
chain. Printed last are the root mean squares over the strips.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.gap.fit import fit
from cell.gap.subject.strip.synthetic import Fold, Instruments, write_fold
from cell.gap.subject.strip.ways import way_of
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.twin.chain.engine import Chain
from policies.experiments.standard import STANDARD, standard_order
from policies.registry import MOTION

LINKS = 200
STRIPS = ("denim", "trouser-twill", "rib-knit", "interlock", "tablecloth")


class Quiet(np.random.Generator):
    """Chance without noise: uniform numbers stay, normal ones are their mean."""

    def normal(self, loc=0.0, scale=1.0, size=None):  # type: ignore[no-untyped-def,override]
        """The mean (size)."""
        return loc + 0.0 * super().normal(loc, scale, size)


def main() -> int:
    """One line a strip."""
    parser = argparse.ArgumentParser(description="Engines against each other.")
    parser.add_argument("strips", nargs="*", default=STRIPS)
    parser.add_argument("--step", type=float, default=0.004, help="of the chain [s]")
    asked = parser.parse_args()
    found = []
    for name in asked.strips:
        found.append(_differences(name, asked.step))
        _say(name, found[-1])
    _say("rms", tuple(np.sqrt(np.mean(np.square(found), axis=0))))
    return 0


def _differences(name: str, step: float) -> tuple[float, float]:
    """Bending length and retardation time of the fit over those of the chain, less one."""
    configs = find_configs(None)
    strip, rng = configs.strip(name), Quiet(np.random.PCG64(1))
    order = standard_order(np.random.default_rng(0))
    with TemporaryDirectory() as place:
        for index, motion in enumerate(order):
            way, chain = way_of(STANDARD[motion].of(strip.length)), Chain(LINKS)
            model = describe(strip, index=index)
            moved = simulate(chain, model, way.t, way.poses, dt=step, shapes=True)
            fold = Fold(way, model, moved, moved.t, chain.arc()[0], index, MOTION + motion)
            write_fold(Path(place) / "runs" / f"{index:02d}-{motion}", name, fold, Instruments(),
                       rng)  # fmt: skip
        verdict = fit([Path(place) / "runs"], configs.strip_path(name), Path(place) / "out")
    base = verdict.base
    length = base["bending_length"].value / strip.bending_length - 1.0
    return length, base["retardation_time"].value / strip.retardation_time - 1.0


def _say(name: str, difference: tuple[float, float]) -> None:
    sys.stdout.write(f"{name:14s} bending length {100 * difference[0]:+.2f} %, "
                     f"retardation time {100 * difference[1]:+.2f} %\n")  # fmt: skip
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
