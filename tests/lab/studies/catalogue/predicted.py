"""Study of `adaptive` on the strips of the cell, as in their files and with unknown
effects.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.base.config.places import find_configs
from drivers.strip.describe import load_plant
from tests.lab.studies.kit.folds import QUANTITIES, compare, fold_strip
from tests.lab.studies.study import Study, Values


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through strips and plants, then seeds of the
    noise.
    """
    configs = find_configs(None)
    plants = sorted(path.stem for path in (configs.folder / "plants").glob("*.yaml"))
    subjects = [(name, "") for name in configs.strip_names()]
    subjects += [(name, name) for name in plants if name in configs.strip_names()]
    noise, which = divmod(number, len(subjects))
    strip, plant = subjects[which]
    return {
        "strip": strip,
        "plant": plant,
        "kind": "plant" if plant else "strip",
        "noise": noise,
    }


def measure(case: Values) -> Values:
    """Facts of the fold, and the errors of its prediction."""
    plants = find_configs(None).folder / "plants"
    plant = load_plant(plants / f"{case['plant']}.yaml") if case["plant"] else None
    with TemporaryDirectory() as place:
        where = Path(place)
        return compare(
            fold_strip(case["strip"], "adaptive", case["noise"], where, plant=plant)
        )


STUDY = Study(
    name="predicted",
    question=(
        "How far off does `adaptive` fold the cell's strips and plants, and does it"
        " say so?"
    ),
    draw=draw,
    measure=measure,
    by=("kind", "strip"),
    quantities=QUANTITIES,
    usual=39,
    quick=1,
    seconds=10.0,
)
