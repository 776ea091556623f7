"""Study of consecutive folds of one specimen by a learning cell, both right and faulty.

The controller does not know what is wrong. In a wrong cell a ruler measures the first
fold, once.
"""

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.base.config.places import find_configs
from cell.folding.experience import Memory, experience_by_ruler
from cell.folding.result import FoldResult
from cell.record.run import read_run
from drivers.base.readers import read_yaml
from drivers.strip.file import StripFile
from policies.strip_sampling import STRIP_LENGTH, draw_friction, plain_strip
from tests.lab.studies.kit.folds import changed_since, compare, fold_unknown
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage

RIGHT_CELL = "right"
WRONG_CELLS: Mapping[str, Mapping[str, Mapping[str, float]]] = read_yaml(
    Path(__file__).with_suffix(".yaml")
)
THICKER = {"stated 0.5 mm thicker": 5e-4}  # m
SHORT_SERIES, LONG_SERIES, CHANGED_SERIES = (
    "two folds",
    "three folds",
    "wrong from fold 4 on",
)
SERIES_FOLDS = {SHORT_SERIES: 2, LONG_SERIES: 3, CHANGED_SERIES: 5}
CONDITIONS = (
    (RIGHT_CELL, SHORT_SERIES),
    *((cell, LONG_SERIES) for cell in (RIGHT_CELL, *WRONG_CELLS)),
    *((cell, CHANGED_SERIES) for cell in ("tool 3 mm off", "images 20 ms old")),
)
FOLDS_BEFORE = 3  # folds of a right cell before it changes
RULER_MARK = 5e-4  # m, to which a ruler is read
FRICTION_RANGE = (20.0, 60.0)  # 1/m, of every second strip


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a strip for the next cell and series; every second one has yarn friction."""
    turn, which = divmod(number, len(CONDITIONS))
    cell, series = CONDITIONS[which]
    rubs = (
        {"bending_hysteresis": draw_friction(rng, *FRICTION_RANGE)}
        if (turn + which) % 2
        else {}
    )
    content = plain_strip(rng, STRIP_LENGTH, **rubs).model_dump(
        mode="json", by_alias=True
    )
    return {"cell": cell, "series": series, "strip": content, "noise": number}


def measure(case: Values) -> Values:
    """Facts of each fold, the biases that the cell learned, and whether it noticed a
    change.
    """
    cell, series = case["cell"], case["series"]
    found: dict[str, object] = {}
    with TemporaryDirectory() as name:
        place, runs = Path(name), []
        memory = place / "memory"
        for number in range(SERIES_FOLDS[series]):
            result = _fold(case, number, place, memory)
            runs.append(Path(result.run).name)
            found |= {
                f"{key}_{number + 1}": value
                for key, value in _facts(case, result).items()
            }
            if series == LONG_SERIES and cell != RIGHT_CELL and number == 0:
                _measure_by_ruler(result, memory)
        since = changed_since(StripFile.model_validate(case["strip"]), memory)
    noticed = since in runs[FOLDS_BEFORE:] if series == CHANGED_SERIES else None
    return {
        **found,
        "worse": _growth(found),
        "noticed": noticed,
        "alarm": since is not None and not noticed,
    }


def _fold(case: Values, number: int, place: Path, memory: Path) -> FoldResult:
    """Run fold `number` of the series, by a cell that learns in `memory`."""
    strip = StripFile.model_validate(case["strip"])
    wrong = case["cell"] != RIGHT_CELL and not (
        case["series"] == CHANGED_SERIES and number < FOLDS_BEFORE
    )
    effects = {**strip.effects, **(WRONG_CELLS[case["cell"]] if wrong else {})}
    thicker = THICKER.get(case["cell"], 0.0) if wrong else 0.0
    plant, seed = (
        strip.model_copy(update={"effects": effects}),
        10 * case["noise"] + number,
    )
    return fold_unknown(plant, seed, place, memory=memory, thicker=thicker)


def _facts(case: Values, result: FoldResult) -> Values:
    """Facts of one fold: d by truth, and the bias left in images [m]."""
    displacement = result.displacement
    known, learning = compare(result), read_run(Path(result.run)).header.learning or {}
    facts = {
        k: known.get(k) for k in ("outcome", "true", "edges", "within_1", "within_2")
    }
    facts |= {"corrected": learning["seen"], "place": learning["place"]}
    facts |= {"seen": displacement, "edges_seen": result.edge_offset}
    if "predicted" in known and displacement is not None:
        facts["bias"] = displacement - known["predicted"] + learning["seen"]
    return facts


def _measure_by_ruler(result: FoldResult, memory: Path) -> None:
    """Teach the cell the edge offset read with a ruler, where the camera saw the edges
    too.
    """
    if result.edge_offset is not None and result.edge_offset_true is not None:
        edges = RULER_MARK * round(result.edge_offset_true / RULER_MARK)
        known = Memory(find_configs(None).cell().name, memory, twin=True)
        known.add(experience_by_ruler(Path(result.run), edges, known))


def _growth(found: Mapping[str, object]) -> float | None:
    """Increase [m] of the mean |d| from the first fold to later ones; None if one is
    missing.
    """
    first, *others = (
        found.get(f"true_{number + 1}") for number in range(max(SERIES_FOLDS.values()))
    )
    learned = [abs(one) for one in others if isinstance(one, float)]
    return (
        float(np.mean(learned)) - abs(first)
        if learned and isinstance(first, float)
        else None
    )


STUDY = Study(
    name="series",
    question=(
        "Does the second fold of a specimen profit from the first, even in a wrong"
        " cell?"
    ),
    draw=draw,
    measure=measure,
    by=("cell", "series"),
    quantities=(
        Quantity("true_1", Statistic.MEAN_SIZE, label="|d| of fold 1"),
        Quantity("true_2", Statistic.MEAN_SIZE, label="of fold 2"),
        Quantity("true_2", Statistic.P95_SIZE, label="95 %"),
        Quantity("true_2", Statistic.WORST_SIZE, label="worst"),
        Quantity("true_3", Statistic.MEAN_SIZE, label="of fold 3"),
        *(
            Quantity(f"{name}_{n}", Statistic.MEAN_SIZE, label=f"|{name}| of fold {n}")
            for name, n in product(("seen", "edges"), (1, 2, 3))
        ),
        Quantity("worse", Statistic.MEAN, label="worse by learning"),
        percentage("noticed", "change noticed"),
        percentage("alarm", "false alarm"),
    ),
    usual=12 * len(CONDITIONS),
    quick=1,
    seconds=30.0,
)
