"""By how much two engines differ in the base: the rod fitted to runs of a chain without noise.

python -m tests.benchmarks.measure_damping [--out damping.yaml]

Neither damps more: their shapes are 17 um apart, and a percent of damping moves a shape by 2 um. A
rod on a harder desk and a chain of more links come closer. The gap workflow takes the root mean
square over strips for the model's own error: `cell/gap/subject/strip/damping.yaml`, written here.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cell.config.places import find_configs
from cell.gap.fit import fit
from cell.gap.subject.strip.bias import DAMPING
from cell.gap.subject.strip.synthetic import Fold, Instruments, write_fold
from cell.gap.subject.strip.ways import way_of
from cell.record.documents import write_document
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.twin.chain.engine import Chain
from policies.experiments.standard import STANDARD, standard_order
from policies.registry import MOTION

LINKS, STEP = 200, 0.004  # of the chain; s


class Quiet(np.random.Generator):
    """Chance without noise: uniform numbers stay, normal ones are their mean."""

    def normal(self, loc: Any = 0.0, scale: Any = 1.0, size: Any = None) -> Any:
        """The mean (size)."""
        return loc + 0.0 * super().normal(loc, scale, size)


def differences(name: str) -> tuple[float, float]:
    """Bending length and retardation time of the fit over those of the chain, less one."""
    configs = find_configs(None)
    strip = configs.strip(name)
    with TemporaryDirectory() as place:
        for index, motion in enumerate(standard_order(np.random.default_rng(0))):
            way, chain = way_of(STANDARD[motion].of(strip.length)), Chain(LINKS)
            model = describe(strip, index=index)
            made = simulate(chain, model, way.t, way.poses, dt=STEP, shapes=True)
            fold = Fold(way, model, made, made.t, chain.arc()[0], index, MOTION + motion)
            folder = Path(place) / "runs" / f"{index:02d}-{motion}"
            write_fold(folder, strip.name, fold, Instruments(), Quiet(np.random.PCG64(1)))
        path = configs.strip_path(strip.name)
        base = fit([Path(place) / "runs"], path, Path(place) / "out").base
    length = base["bending_length"].value / strip.bending_length - 1.0
    return length, base["retardation_time"].value / strip.retardation_time - 1.0


def main() -> None:
    """A line a strip, then the data file of their root mean square."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=DAMPING)
    asked, found = parser.parse_args(), []
    names = find_configs(None).strip_names()
    for name in names:
        length, damping = differences(name)
        found.append(damping)
        sys.stdout.write(f"{name:14s} bending length {100 * length:+.2f} %, "
                         f"retardation time {100 * damping:+.2f} %\n")  # fmt: skip
        sys.stdout.flush()
    content = {"schema": 1, "damping": float(np.sqrt(np.mean(np.square(found))))}
    source = (
        f"root mean square over {', '.join(names)}; `python -m tests.benchmarks.measure_damping`"
    )
    belongs = {"source": source, "belongs_to": "cell/gap/subject/strip/damping.yaml"}
    write_document(asked.out, {**content, "strips": len(found), **belongs})


if __name__ == "__main__":
    main()
