"""Study of strips at the ends of the allowed range: folded, refused, stopped, inaccurate.

Good ends: the layers truly touched within 25 mm, or the fold was refused before anything moved, or
it was stopped and says why. Untrue is a touch that the twin does not know, or another displacement
than the twin's by more than 10 mm.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from cell.config.places import find_configs
from cell.folding.result import FoldResult
from drivers.errors import CellError
from policies.registry import policy_names
from tests.lab.studies.kit.folds import fold_strip
from tests.lab.studies.study import Quantity, Statistic, Study, Values

DISPLACEMENT_LIMIT, ERROR_LIMIT = 0.025, 0.010  # m
STRIPS: dict[str, dict[str, float]] = {
    "short": {"length": 0.1},
    "long": {"length": 2.0},
    "narrow": {"width": 0.002},
    "wide": {"width": 1.0},
    "thick": {"thickness": 0.02},
    "soft": {"bending_length": 0.002},
    "stiff": {"bending_length": 0.2},
    "light": {"areal_density": 0.001},
    "heavy": {"areal_density": 50.0},
    "sluggish": {"retardation_time": 10.0},
}


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through the extreme strips, then through the policies."""
    policy, strip = divmod(number, len(STRIPS))
    return {"strip": list(STRIPS)[strip], "policy": policy_names()[policy % len(policy_names())]}


def measure(case: Values) -> Values:
    """Fold an extreme strip and classify how the fold ended."""
    content = yaml.safe_load(find_configs(None).strip_path("denim").read_text(encoding="utf-8"))
    changed = {**content, **STRIPS[case["strip"]], "name": case["strip"]}
    with TemporaryDirectory() as place:
        path = Path(place) / f"{case['strip']}.yaml"
        path.write_text(yaml.safe_dump(changed), encoding="utf-8")
        try:
            result = fold_strip(str(path), case["policy"], 0, Path(place))
        except CellError as error:
            return {"ended": f"refused: {error}", "untrue": False, "far": False, "folded": False}
    return judge_fold(result)


def judge_fold(result: FoldResult) -> Values:
    """Classify how a fold ended: whether its measurement is true and its displacement small."""
    seen, true = result.displacement, result.displacement_true
    touched = result.outcome == "layer_touch"
    if not touched:
        untrue = result.exit_code == 0
        return {"ended": result.outcome, "untrue": untrue, "far": False, "folded": False}
    untrue = seen is None or true is None or abs(seen - true) > ERROR_LIMIT
    far = not untrue and true is not None and abs(true) > DISPLACEMENT_LIMIT
    return {"ended": "folded", "untrue": untrue, "far": far, "folded": not (untrue or far)}


STUDY = Study(
    name="extremes",
    question="Is every end of an extreme strip true: folded, refused, or stopped with a reason?",
    draw=draw,
    measure=measure,
    by=("strip",),
    quantities=(
        Quantity("untrue", Statistic.COUNT, "", 1.0, bar=0.0, label="untrue", digits=0),
        Quantity("far", Statistic.COUNT, "", 1.0, label="far", digits=0),
        Quantity("folded", Statistic.COUNT, "", 1.0, label="folded", digits=0),
    ),
    usual=60,
    quick=1,
    seconds=10.0,
)
