"""Study of the engines' difference in base parameters: the rod fitted to noise-free
chain runs.

Their shapes are 17 um apart, and a percent of damping moves a shape by 2 um. A rod on a
harder desk and a chain of more links come closer. Every second case is led by hand,
where the rod takes more of the difference for damping. The gap workflow takes the root
mean square over cases for the model's own error.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cell.base.config.places import find_configs
from cell.gap.fit import fit
from cell.gap.subject.strip.synthetic import BENCH, Fold, reported_path, write_fold
from drivers.strip.describe import describe
from drivers.strip.rod.engine import GripperPath
from drivers.twin.chain.engine import Chain
from policies.experiments.standard import STANDARD, standard_order
from policies.registry import MOTION
from tests.lab.exam.from_state import paths_by_hand
from tests.lab.studies.study import Fit, Outcome, Quantity, Statistic, Study, Values
from tests.support.effect_cases import simulate

LINKS, STEP = 200, 0.004  # of the chain; s
MOTIONS = ("standard", "by hand")


class Quiet(np.random.Generator):
    """Random generator without noise: normal numbers equal their mean, others are
    drawn.
    """

    def normal(self, loc: Any = 0.0, scale: Any = 1.0, size: Any = None) -> Any:
        """The mean `loc` of a normal distribution, as an array of this size."""
        return loc + 0.0 * super().normal(loc, scale, size)


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw the next strip of the cell and its motions, which are others in each
    round.
    """
    strips = find_configs(None).strip_names()
    turn, strip = divmod(number // 2, len(strips))
    return {"strip": strips[strip], "motions": MOTIONS[number % 2], "order": turn}


def measure(case: Values) -> Values:
    """Relative errors of bending length and retardation time of the rod fitted to the
    chain.
    """
    configs = find_configs(None)
    strip = configs.strip(case["strip"])
    with TemporaryDirectory() as place:
        for index, (condition, path) in enumerate(_paths(case, strip.length)):
            model, chain = describe(strip, index=index), Chain(LINKS)
            made = simulate(chain, model, path.t, path.poses, dt=STEP, shapes=True)
            fold = Fold(path, model, made, made.t, chain.arc()[0], index, condition)
            folder = Path(place) / "runs" / f"{index:02d}"
            write_fold(folder, strip.name, fold, BENCH, Quiet(np.random.PCG64(1)))
        strip_file = configs.strip_path(strip.name)
        base = fit([Path(place) / "runs"], strip_file, Path(place) / "out").base
    return {
        "length": base["bending_length"].value / strip.bending_length - 1.0,
        "damping": base["retardation_time"].value / strip.retardation_time - 1.0,
    }


def _paths(case: Values, length: float) -> list[tuple[str, GripperPath]]:
    """Condition and gripper path of each motion of `case` over a strip of `length`
    [m].
    """
    names = standard_order(np.random.default_rng(case["order"]))
    if case["motions"] == "standard":
        return [
            (MOTION + name, reported_path(STANDARD[name].over(length)))
            for name in names
        ]
    paths = paths_by_hand(length, case["order"], len(names))
    return [(f"by-hand-{i}", path) for i, path in enumerate(paths, start=1)]


def model_error(outcomes: Sequence[Outcome]) -> Values:
    """Root mean square over cases of the engines' relative difference in damping."""
    found = [o.values["damping"] for o in outcomes]
    names = list(dict.fromkeys(o.case.values["strip"] for o in outcomes))
    source = f"root mean square over {', '.join(names)};"
    return {
        "schema": 1,
        "damping": float(np.sqrt(np.mean(np.square(found)))),
        "strips": len(names),
        "source": source,
    }


STUDY = Study(
    name="damping",
    question="By how much do rod and chain differ in bending length and damping?",
    draw=draw,
    measure=measure,
    by=("motions",),
    quantities=(
        Quantity("damping", Statistic.RMS, "%", 100.0, label="damping rms"),
        Quantity("length", Statistic.RMS, "%", 100.0, label="bending length rms"),
    ),
    fits=(Fit("cell/gap/subject/strip/damping.yaml", model_error),),
    usual=20,
    quick=0,
    seconds=45.0,
)
