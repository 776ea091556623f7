"""Study of faults in every state of a fold: which monitor notices each, and how the
fold ends.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.lab.faults.blow import FAULT_STATES, Blow, strike
from tests.lab.faults.faults import FAULTS
from tests.lab.studies.kit.folds import cached_calibration
from tests.lab.studies.study import (
    Quantity,
    Statistic,
    Study,
    Values,
    percentage,
)

SEEDS = 3
ACCEPTABLE_VERDICTS = ("stopped", "harmless")


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all faults, then states, then seeds of the
    noise.
    """
    number, fault = divmod(number, len(FAULTS))
    seed, state = divmod(number, len(FAULT_STATES))
    return {"fault": list(FAULTS)[fault], "state": FAULT_STATES[state], "noise": seed}


def measure(case: Values) -> Values:
    """Result of a fold with an injected fault: times [s], distances [m], and the
    verdict on it.
    """
    blow = Blow(case["fault"], case["state"], case["noise"])
    with TemporaryDirectory() as place:
        came = dict(strike(blow, Path(place), cached_calibration()))
        for key in ("outcome", "message"):
            came[key] = str(came[key]).replace(place, "RUNS")
    struck = came["verdict"] != "not struck"
    return came | {
        "noticed": came["verdict"] in ACCEPTABLE_VERDICTS if struck else None
    }


STUDY = Study(
    name="faults",
    question=(
        "Which faults are noticed, by which monitor, and does the arm always come to"
        " rest?"
    ),
    draw=draw,
    measure=measure,
    by=("fault",),
    quantities=(
        *(
            percentage(name, bar=100.0)
            for name in ("noticed", "resting", "within", "whole")
        ),
        Quantity("stop", Statistic.WORST_SIZE, "s", 1.0, label="worst to the stop"),
        Quantity("rest", Statistic.WORST_SIZE, "s", 1.0, label="worst to rest"),
        Quantity("distance", Statistic.WORST_SIZE, label="worst way"),
    ),
    usual=SEEDS * len(FAULT_STATES) * len(FAULTS),
    quick=1,
    seconds=6.0,
    limit=600.0,
)
