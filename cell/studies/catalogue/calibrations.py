"""Folds with the calibration that the wizards leave, beside those with the twin's own."""

import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calibration.calibration import Calibration, load_calibration
from cell.campaign.statistic import Quantity, Statistic
from cell.campaign.study import Study, Values
from cell.config.places import find_configs
from cell.studies.kit.folds import fold_strip


def draw(number: int, _rng: np.random.Generator) -> Values:
    """The next strip."""
    noise, strip = divmod(number, len(find_configs(None).strip_names()))
    return {"strip": find_configs(None).strip_names()[strip], "noise": noise}


def measure(case: Values) -> Values:
    """d by truth [m] with the wizards' calibration, and how far from that with the twin's own."""
    with TemporaryDirectory() as place:
        own, wizard = (
            fold_strip(case["strip"], "feedback", case["noise"], Path(place), calibration=each)
            .displacement_true
            for each in (None, by_wizards())
        )  # fmt: skip
    apart = None if own is None or wizard is None else wizard - own
    grown = None if own is None or wizard is None else abs(wizard) - abs(own)
    return {"wizard": wizard, "apart": apart, "grown": grown}


@cache
def by_wizards() -> Calibration:
    """The calibration that both wizards leave, run unattended as an operator starts them."""
    with TemporaryDirectory() as place:
        for kind in ("camera", "homography"):
            command = [sys.executable, "-m", "cell", "calibrate", kind, "--viz", "off"]
            subprocess.run(command, cwd=place, check=True, stdout=subprocess.DEVNULL)  # noqa: S603
        found = next(Path(place).glob("calibrations/*-homography/calibration.yaml"))
        return load_calibration(found)


STUDY = Study(
    name="calibrations",
    question="Does a strip fold as well with the wizards' calibration as with the twin's own?",
    draw=draw,
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
