"""Study of the engines' difference in base parameters: the rod fitted to noise-free chain runs.

Neither damps more: their shapes are 17 um apart, and a percent of damping moves a shape by 2 um. A
rod on a harder desk and a chain of more links come closer. The gap workflow takes the root mean
square over strips for the model's own error.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cell.campaign.statistic import Quantity, Statistic
from cell.campaign.study import Fit, Outcome, Study, Values
from cell.config.places import find_configs
from cell.gap.fit import fit
from cell.gap.subject.strip.synthetic import Fold, Instruments, write_fold
from cell.gap.subject.strip.ways import way_of
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from drivers.twin.chain.engine import Chain
from policies.experiments.standard import STANDARD, standard_order
from policies.registry import MOTION

LINKS, STEP = 200, 0.004  # of the chain; s


class Quiet(np.random.Generator):
    """Random generator without noise: normal numbers equal their mean, others are drawn."""

    def normal(self, loc: Any = 0.0, scale: Any = 1.0, size: Any = None) -> Any:
        """The mean `loc` of a normal distribution, as an array of this size."""
        return loc + 0.0 * super().normal(loc, scale, size)


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw the next strip of the cell, with another order of motions in each round."""
    strips = find_configs(None).strip_names()
    order, strip = divmod(number, len(strips))
    return {"strip": strips[strip], "order": order}


def measure(case: Values) -> Values:
    """Relative errors of bending length and retardation time of the rod fitted to the chain."""
    configs = find_configs(None)
    strip = configs.strip(case["strip"])
    with TemporaryDirectory() as place:
        for index, motion in enumerate(standard_order(np.random.default_rng(case["order"]))):
            way, chain = way_of(STANDARD[motion].of(strip.length)), Chain(LINKS)
            model = describe(strip, index=index)
            made = simulate(chain, model, way.t, way.poses, dt=STEP, shapes=True)
            fold = Fold(way, model, made, made.t, chain.arc()[0], index, MOTION + motion)
            folder = Path(place) / "runs" / f"{index:02d}-{motion}"
            write_fold(folder, strip.name, fold, Instruments(), Quiet(np.random.PCG64(1)))
        path = configs.strip_path(strip.name)
        base = fit([Path(place) / "runs"], path, Path(place) / "out").base
    return {
        "length": base["bending_length"].value / strip.bending_length - 1.0,
        "damping": base["retardation_time"].value / strip.retardation_time - 1.0,
    }


def model_error(outcomes: Sequence[Outcome]) -> Values:
    """Root mean square over strips of the engines' relative difference in damping."""
    found = [o.values["damping"] for o in outcomes]
    names = ", ".join(dict.fromkeys(o.case.values["strip"] for o in outcomes))
    return {"schema": 1, "damping": float(np.sqrt(np.mean(np.square(found)))),
            "strips": len(found), "source": f"root mean square over {names};"}  # fmt: skip


STUDY = Study(
    name="damping",
    question="By how much do rod and chain differ in bending length and damping?",
    draw=draw,
    measure=measure,
    by=("strip",),
    quantities=(
        Quantity("damping", Statistic.RMS, "%", 100.0, label="damping rms"),
        Quantity("length", Statistic.RMS, "%", 100.0, label="bending length rms"),
    ),
    fits=(Fit("cell/gap/subject/strip/damping.yaml", model_error),),
    usual=10,
    quick=0,
    seconds=45.0,
)
