"""Study of folds with the wizards' calibration beside folds with the twin's own."""

import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from calibration.calibration import Calibration, load_calibration
from tests.lab.studies.kit.folds import difference, fold_strip, next_strip
from tests.lab.studies.study import Quantity, Statistic, Study, Values


def measure(case: Values) -> Values:
    """True displacement [m] with the wizards' calibration, and its change from the twin's own.

    The change is signed (`apart`) and in size (`grown`).
    """
    own, wizard = (_displacement(case, calibration) for calibration in (None, by_wizards()))
    sizes = (None if d is None else abs(d) for d in (wizard, own))
    return {"wizard": wizard, "apart": difference(wizard, own), "grown": difference(*sizes)}


def _displacement(case: Values, calibration: Calibration | None) -> float | None:
    """True displacement [m] of the fold of a case."""
    strip, noise = case["strip"], case["noise"]
    with TemporaryDirectory() as place:
        made = fold_strip(strip, "feedback", noise, Path(place), calibration=calibration)
    return made.displacement_true


@cache
def by_wizards() -> Calibration:
    """Run both calibration wizards unattended, as an operator starts them; cached."""
    with TemporaryDirectory() as place:
        for kind in ("camera", "homography"):
            command = [sys.executable, "-m", "cell", "calibrate", kind, "--viz", "off"]
            subprocess.run(command, cwd=place, check=True, stdout=subprocess.DEVNULL)
        found = next(Path(place).glob("calibrations/*-homography/calibration.yaml"))
        return load_calibration(found)


STUDY = Study(
    name="calibrations",
    question="Does a strip fold as well with the wizards' calibration as with the twin's own?",
    draw=next_strip,
    measure=measure,
    quantities=(
        Quantity("wizard", Statistic.MEAN_SIZE, label="mean |d|"),
        Quantity("grown", Statistic.MEAN, label="|d| grown by", bar=0.5),
        Quantity("apart", Statistic.WORST_SIZE, label="worst |difference of d|", bar=1.5),
    ),
    usual=10,
    quick=1,
    seconds=25.0,
)
