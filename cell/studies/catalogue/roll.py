"""How far folds roll on after the touch, on the chain, and what the loop of a laid strip holds.

Each fold by `adaptive` is laid down twice and let go: by a lay that ends short, from which the edge
springs to where the fold rolled, and by the cell's lay, which ends at the fixed edge.
"""

from collections.abc import Sequence

import numpy as np

from cell.orchestrator.lay import BRAKING, CREEP, HANGING, TURNING, lay_path
from cell.perception.measurement import SeenTouch
from cell.report.statistic import Quantity, Statistic
from cell.studies.kit.rollouts import Traced
from cell.studies.study import Fit, Outcome, Study, Values
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.shape import Touch
from drivers.twin.chain.engine import Chain
from drivers.types import Array, Pose
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.fabrics import friction, plain
from policies.path import Path
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGES

LINKS = 80
DT = 0.005  # s
SEEN_AFTER = 0.1  # s after the touch, when it is reported
SPEED = 0.1  # m/s
SHORT = 0.006  # m before the taut edge
TOLERANCE = 1.5e-3  # m of the robust fit


def draw(_number: int, rng: np.random.Generator) -> Values:
    """A smooth or a rough strip."""
    rough = rng.uniform() < 0.5
    strip = plain(rng, bending_hysteresis=friction(rng, 5.0, 60.0)) if rough else plain(rng)
    content = strip.model_dump(mode="json", by_alias=True)
    return {"kind": "rough" if rough else "smooth", "strip": content}


def measure(case: Values) -> Values:
    """d, the offsets after both lays, height of the loop and its end [m]."""
    strip = StripFile.model_validate(case["strip"])
    engine, rng = Traced(Chain(LINKS)), np.random.default_rng(0)
    policy, sensed = Adaptive(load_critic()), Rollout(sensing=IMAGES)
    folds = roll_out(policy, engine, strip, [describe(strip)], settings=sensed, rng=rng)
    touch = folds.touch[0]
    if touch is None:
        return {"d": None}
    poses, dt, rest = np.array(engine.poses)[1:, 0], engine.times[1], max(strip.thickness, 0.001)
    end = (SHORT - touch.displacement, rest)
    short, _, _ = _lay(strip, poses, dt, end, touch)
    offset, tip, height = _lay(strip, poses, dt, None, touch)
    straight = strip.length - 2 * tip
    rubbing = strip.effects.get("bending_hysteresis", {}).get("yield_curvature", 0.0)
    return {
        "d": touch.displacement,
        "short": short,
        "rolled": short - touch.displacement,
        "offset": offset,
        "loop": offset - straight,
        "height": height,
        "thickness": strip.thickness,
        "logs": [np.log(strip.bending_length), np.log(strip.retardation_time),
                 np.log1p(rubbing / 10.0)],
    }  # fmt: skip


def _lay_poses(path: Path) -> Array:
    """Poses (k, 3) of the cell's lay along `path`, `DT` apart."""
    speed, progress, poses = min(SPEED, TURNING * path.length / HANGING), 0.0, []
    while progress < path.length:
        pace = min(speed, max(CREEP, float(np.sqrt(2 * BRAKING * (path.length - progress)))))
        progress = min(progress + pace * DT, path.length)
        poses.append([*path.at(progress), HANGING * (1 + progress / path.length)])
    return np.array(poses)


def _lay(
    strip: StripFile, poses: Array, dt: float, end: tuple[float, float] | None, touch: Touch
) -> tuple[float, float, float]:
    """Final offset of the edges, x of the loop's end and its height [m] after a lay to `end`, or
    the cell's.
    """
    chain = Chain(LINKS)
    chain.reset([describe(strip)])
    for pose in poses:
        chain.step(pose[None], dt)
    velocity = (poses[-1] - poses[-2]) / dt
    steps = np.arange(1, round(SEEN_AFTER / DT) + 1)[:, None]
    on = poses[-1] + steps * DT * velocity
    seen = SeenTouch(touch.time, touch.x, touch.to_grasped, touch.to_fixed, 1.0, strip.thickness)
    path = lay_path(seen, Pose(*on[-1]), max(strip.thickness, 0.001))
    if end is not None:
        path = Path.through(np.array([path.points[0], end]))
    down = _lay_poses(path)
    still = np.tile(down[-1], (round(0.2 / DT), 1))
    for pose in (*on, *down, *still):
        chain.step(pose[None], DT)
    chain.release()
    for _ in range(round(0.8 / DT)):
        chain.step(down[-1][None], DT)
    shape = chain.shapes()[0]
    return -float(shape[-1, 0]), float(shape[:, 0].max()), float(shape[:, 1].max())


def fits(outcomes: Sequence[Outcome]) -> Values:
    """Weights of (1, height, thickness) for the strip that the loop holds [m]."""
    rows = [o.values for o in outcomes if o.values["d"] is not None]
    column = {name: np.array([row[name] for row in rows]) for name in
              ("loop", "height", "thickness")}  # fmt: skip
    terms = np.stack([np.ones(len(rows)), column["height"], column["thickness"]], axis=1)
    return {"loop": _robust(terms, column["loop"]), "folds": len(rows)}


def _robust(terms: Array, values: Array) -> dict[str, object]:
    """Robust least squares of `values` (n,) [m] by `terms` (n, k)."""
    weight: Array = np.ones(len(values))
    found: Array = np.zeros(terms.shape[1])
    for _ in range(6):
        found = np.asarray(np.linalg.lstsq(terms * weight[:, None], values * weight, rcond=None)[0])
        weight = 1.0 / np.sqrt(1.0 + ((values - terms @ found) / TOLERANCE) ** 2)
    return {"weights": found.tolist(), "rms": float(np.std(values - terms @ found))}


STUDY = Study(
    name="roll",
    question="How far do folds roll on after the touch, and where do the edges end?",
    draw=draw,
    measure=measure,
    by=("kind",),
    quantities=(
        Quantity("d", Statistic.MEAN_SIZE, label="mean |d|"),
        Quantity("rolled", Statistic.MEAN, label="mean roll"),
        Quantity("offset", Statistic.MEAN_SIZE, label="mean |offset|"),
        Quantity("offset", Statistic.P95_SIZE, label="95 % |offset|"),
        Quantity("offset", Statistic.WORST_SIZE, label="worst |offset|"),
    ),
    fit=Fit("cell/perception/laid.py", fits),
    usual=60,
    quick=1,
    seconds=8.0,
)
