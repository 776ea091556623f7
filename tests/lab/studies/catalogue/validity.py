"""Study of the range in which rod and chain are valid: strips ever further from
ordinary fabric.

The bounds in `drivers/strip/describe.py` are read off this table.
"""

from collections.abc import Callable

import numpy as np

from cell.base.config.places import find_configs
from drivers.base.errors import CellError
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out
from tests.lab.studies.study import Quantity, Statistic, Study, Values

SWEEPS = {
    "bending_length": (
        0.0135,
        0.002,
        0.004,
        0.006,
        0.008,
        0.010,
        0.033,
        0.045,
        0.06,
        0.08,
        0.1,
        0.2,
    ),
    "length": (0.1, 0.15, 0.2, 0.3, 0.45, 0.9, 1.2, 2.0),
    "width": (0.002, 0.01, 0.2, 1.0),
    "thickness": (1e-5, 1e-4, 0.004, 0.008, 0.02),
    "areal_density": (0.001, 0.01, 0.05, 2.0, 10.0, 50.0),
    "retardation_time": (0.0, 1e-3, 4e-3, 0.2, 1.0, 3.0, 10.0),
}
CHANGES = [(key, value) for key, values in SWEEPS.items() for value in values]
ENGINES: dict[str, tuple[Callable[[], Stepper], Callable[[], Stepper]]] = {
    "rod": (lambda: Rod(100), lambda: Rod(200)),
    "chain": (lambda: Chain(80), lambda: Chain(160)),
}


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw one changed property of denim, on one engine."""
    change, engine = divmod(number, len(ENGINES))
    key, value = CHANGES[change % len(CHANGES)]
    return {"engine": list(ENGINES)[engine], "key": key, "value": value}


def measure(case: Values) -> Values:
    """Displacement d [m] along a triangle in the engine as used, and its change in a
    finer one.
    """
    strip = (
        find_configs(None)
        .strip("denim")
        .model_copy(update={case["key"]: case["value"]})
    )
    coarse, fine = (_fold(make(), strip) for make in ENGINES[case["engine"]])
    if isinstance(coarse, str) or isinstance(fine, str):
        reason = coarse if isinstance(coarse, str) else fine
        return {"d": None, "apart": None, "ended": False, "reason": reason}
    return {"d": coarse, "apart": fine - coarse, "ended": True, "reason": ""}


def _fold(engine: Stepper, strip: StripFile) -> float | str:
    """Displacement d [m] of the fold, or the reason why there is none."""
    policy, rng = make_policy("triangular"), np.random.default_rng(0)
    try:
        settings = Rollout(substeps=4)
        ended = roll_out(
            policy, engine, strip, [describe(strip)], settings=settings, rng=rng
        )
    except CellError as error:
        return str(error).partition(":")[0]
    return float(ended.displacement[0]) if ended.touched[0] else "no touch"


STUDY = Study(
    name="validity",
    question=(
        "Where can rod and chain be believed: does half their step in space change d?"
    ),
    draw=draw,
    measure=measure,
    by=("engine", "key", "value"),
    quantities=(
        Quantity("d", Statistic.MEAN, label="d", digits=1),
        Quantity("apart", Statistic.WORST_SIZE, label="|finer - d|", digits=1),
        Quantity(
            "ended", Statistic.SHARE, "%", 100.0, label="ended in a touch", digits=0
        ),
    ),
    usual=2 * len(CHANGES),
    quick=1,
    seconds=6.0,
    limit=600.0,
)
