"""Study of the engines' cost and accuracy on the same folds.

Errors of d are against the rod converged in segments and step; costs are of processor time of one
thread per simulated second of a strip.
"""

import time
from collections.abc import Callable

import numpy as np

from drivers.errors import SimulationNotFinite
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper, simulate
from drivers.strip.file import paper_damping_minimum, paper_strip
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.path import Path, circular, triangular
from tests.lab.studies.kit.paper_formulation import PaperFormulation
from tests.lab.studies.study import Quantity, Statistic, Study, Values

DT, SPEED = 0.005, 0.1  # s, m/s
STIFFNESS_LEVELS, DAMPING_LEVELS = (0.0775, 0.02, 0.3), (7.0, 1.0, 50.0)  # N m/rad; of the least
PATHS = {"triangular": triangular, "circular": circular}
FOLD_CASES = [(k, b, path) for k in STIFFNESS_LEVELS for b in DAMPING_LEVELS for path in PATHS]
REFERENCE = (400, 0.00125)  # segments, step [s]
BATCH_SIZE = 32  # folds in a batch
SUBJECTS: dict[str, Callable[[], Stepper]] = {
    f"rod, 100 segments, {BATCH_SIZE} side by side": lambda: Rod(100),
    "rod, 100 segments": lambda: Rod(100),
    "rod, 50 segments": lambda: Rod(50),
    "rod, 200 segments": lambda: Rod(200),
    "chain, 60 links": lambda: Chain(60),
    "chain, 100 links": lambda: Chain(100),
    "the paper's: 300 links, Euler, soft weld": PaperFormulation,
}


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all engines, then folds from the range's middle on."""
    fold, subject = divmod(number, len(SUBJECTS))
    k, b, path = FOLD_CASES[fold % len(FOLD_CASES)]
    return {"engine": list(SUBJECTS)[subject], "stiffness": k, "damping": b, "path": path}


def measure(case: Values) -> Values:
    """Error of d [m] and cost [s of processor per simulated second] of one engine."""
    k = case["stiffness"]
    model = describe(paper_strip(k, case["damping"] * paper_damping_minimum(k)))
    path, engine = PATHS[case["path"]](0.6), SUBJECTS[case["engine"]]()
    exact, _ = batch(Rod(REFERENCE[0]), model, steady(path, REFERENCE[1]), REFERENCE[1])
    if isinstance(engine, Rod):
        count = BATCH_SIZE if "side by side" in case["engine"] else 1
        d, cost = batch(engine, model, steady(path, DT), DT, count)
    else:
        d, cost = stepwise(engine, model, path)
    return {"error": d - exact, "cost": cost, "finite": bool(np.isfinite(d))}


def steady(path: Path, dt: float) -> Array:
    """Poses (k, 3) along the whole path at constant speed from the first step on."""
    steps = np.arange(1, int(path.length / SPEED / dt) + 1)
    return path.poses(np.minimum(steps * dt * SPEED, path.length))


def batch(
    rod: Rod, model: StripModel, poses: Array, dt: float, count: int = 1
) -> tuple[float, float]:
    """Displacement d [m] of `count` equal folds along poses (k, 3), and cost of one [s/s]."""
    each = np.repeat(poses[:, None], count, axis=1)
    for _ in range(2):  # the first loads the compiled code
        rod.reset([model] * count)
        begun = time.thread_time()
        touch = rod.advance(each, dt).touch[0]
        spent = time.thread_time() - begun
    end = len(poses) * dt if touch is None else touch.time
    return (np.nan if touch is None else touch.displacement), spent / (end * count)


def stepwise(engine: Stepper, model: StripModel, path: Path) -> tuple[float, float]:
    """Displacement d [m] of one fold, step by step as on the twin, and its cost [s/s]."""
    poses = steady(path, DT)
    start = np.array([[path.points[0, 0], 0.0, 0.0]])
    begun = time.thread_time()
    try:
        t: Array = DT * np.arange(len(poses) + 1, dtype=np.float64)
        motion = simulate(engine, model, t, np.concatenate([start, poses]), dt=DT)
    except SimulationNotFinite:
        return float("nan"), float("nan")
    spent = time.thread_time() - begun
    d = np.nan if motion.touch is None else motion.touch.displacement
    return d, spent / float(motion.t[-1])


STUDY = Study(
    name="engines",
    question="What do the engines cost, and how exact are they on the same folds?",
    draw=draw,
    measure=measure,
    by=("engine",),
    quantities=(
        Quantity("cost", Statistic.MEDIAN, "ms/s", label="cost"),
        Quantity("error", Statistic.MEAN_SIZE, label="mean |error of d|"),
        Quantity("error", Statistic.WORST_SIZE, label="worst |error of d|"),
        Quantity("finite", Statistic.SHARE, "%", 100.0, label="finite", digits=0),
    ),
    usual=len(SUBJECTS) * len(FOLD_CASES),
    quick=1,
    seconds=10.0,
)
