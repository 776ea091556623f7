"""Study of folds through images, by policy, and of the agreement of images, truth and rod."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from tests.lab.studies.kit.folds import facts, fold_strip
from tests.lab.studies.kit.resimulate import resimulate
from tests.lab.studies.study import Quantity, Statistic, Study, Values

POLICIES = ("triangular", "circular", "shifted", "planned", "feedback", "adaptive")


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through policies, then strips, then seeds of the noise."""
    strips = find_configs(None).strip_names()
    pair, policy = divmod(number, len(POLICIES))
    seed, strip = divmod(pair, len(strips))
    return {"policy": POLICIES[policy], "strip": strips[strip], "noise": seed}


def measure(case: Values) -> Values:
    """Facts of the fold, and the error [m] of the rod simulated along its gripper path."""
    with TemporaryDirectory() as place:
        result = fold_strip(case["strip"], case["policy"], case["noise"], Path(place))
        rod = resimulate(Path(result.run)).simulated
    true = result.displacement_true
    return {**facts(result), "rod": None if rod is None or true is None else rod - true}


STUDY = Study(
    name="folds",
    question="How far off are folds through images, by policy, and is that seen and modelled?",
    draw=draw,
    measure=measure,
    by=("policy",),
    quantities=(
        Quantity("true", Statistic.MEAN, label="mean d"),
        Quantity("true", Statistic.MEAN_SIZE, label="mean |d|"),
        Quantity("true", Statistic.WORST_SIZE, label="worst |d|"),
        Quantity("misread", Statistic.WORST_SIZE, label="worst |seen - true|"),
        Quantity("edges_misread", Statistic.RMS, label="laid edges, seen - true rms"),
        Quantity("edges_misread", Statistic.WORST_SIZE, label="worst"),
        Quantity("rod", Statistic.WORST_SIZE, label="worst |rod - true|"),
        Quantity("touched", Statistic.SHARE, "%", 100.0, label="touched", digits=0),
    ),
    usual=60,
    quick=1,
    seconds=9.0,
)
