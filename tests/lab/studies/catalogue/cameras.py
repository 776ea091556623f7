"""Study of unmeasured strips folded by `adaptive` through cameras unlike the cell's own."""

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from drivers.strip.file import StripFile
from policies.adaptive.fabrics import STRIP_LENGTH, friction, plain
from tests.lab.studies.kit.folds import QUANTITIES, cell_with_twin, compare, fold_unknown
from tests.lab.studies.study import Study, Values

CAMERAS: Mapping[str, Mapping[str, float]] = {
    "30 Hz, 120 ms": {"rate": 30.0, "transport_delay": 0.12},
    "noise of 8": {"noise": 8.0},
    "960 x 540": {"width": 960, "height": 540},
    "1920 x 1080": {"width": 1920, "height": 1080},
    "1.2 m away": {"distance": 1.2},
    "3.2 m away": {"distance": 3.2},
    "blur of 2 px": {"lens_blur": 2.0},
    "exposure of 12 ms": {"exposure": 0.012},
}
FRICTION_RANGE = (20.0, 60.0)  # 1/m, of every second strip


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a strip for the next camera; in every second round it has yarn friction."""
    turn, which = divmod(number, len(CAMERAS))
    rubs = {"bending_hysteresis": friction(rng, *FRICTION_RANGE)} if turn % 2 else {}
    content = plain(rng, STRIP_LENGTH, **rubs).model_dump(mode="json", by_alias=True)
    return {"camera": list(CAMERAS)[which], "strip": content, "noise": number}


def measure(case: Values) -> Values:
    """Facts of a fold by a cell that was calibrated through this camera."""
    with TemporaryDirectory() as name:
        cell = cell_with_twin(camera=CAMERAS[case["camera"]])
        strip = StripFile.model_validate(case["strip"])
        return dict(compare(fold_unknown(strip, case["noise"], Path(name), cell=cell)))


STUDY = Study(
    name="cameras",
    question="How far off does `adaptive` fold unknown strips through slow, noisy, other cameras?",
    draw=draw,
    measure=measure,
    by=("camera",),
    quantities=QUANTITIES,
    usual=20 * len(CAMERAS),
    quick=1,
    seconds=10.0,
)
