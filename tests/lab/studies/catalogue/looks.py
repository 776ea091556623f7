"""Study of folds of every strip in every look of the cell, with preflight and
images.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.base.config.places import find_configs
from drivers.twin.renderer.looks import LOOKS
from tests.lab.studies.kit.folds import (
    cached_calibration,
    cell_with_twin,
    facts,
    fold_strip,
)
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage

ALLOWED_MM = 6.0  # mm of displacement


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through the looks, then through the cell's
    strips.
    """
    strips = find_configs(None).strip_names()
    strip, look = divmod(number, len(LOOKS))
    return {"look": list(LOOKS)[look], "strip": strips[strip % len(strips)]}


def measure(case: Values) -> Values:
    """Facts of a fold by feedback in one look, with the calibration made in the plain
    look.
    """
    with TemporaryDirectory() as place:
        cell = cell_with_twin(case["look"])
        result = fold_strip(
            case["strip"],
            "feedback",
            0,
            Path(place),
            cell=cell,
            calibration=cached_calibration(),
        )
    refused = result.outcome == "preflight_refused"
    failed = (
        [line.split(":")[0] for line in result.reason.splitlines()] if refused else []
    )
    stopped = not refused and result.displacement is None
    return {
        **facts(result),
        "admitted": not refused,
        "stopped": stopped,
        "refused_by": failed,
    }


STUDY = Study(
    name="looks",
    question=(
        "In which looks of the cell is a strip admitted, and how well is it then"
        " folded?"
    ),
    draw=draw,
    measure=measure,
    by=("look",),
    quantities=(
        Quantity("true", Statistic.WORST_SIZE, label="worst |d|", bar=ALLOWED_MM),
        Quantity("misread", Statistic.WORST_SIZE, label="worst |seen - true|"),
        percentage("admitted", "admitted"),
        Quantity(
            "stopped", Statistic.COUNT, "", 1.0, bar=0.0, label="stopped", digits=0
        ),
    ),
    usual=10 * 12,
    quick=1,
    seconds=9.0,
)
