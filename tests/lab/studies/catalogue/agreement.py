"""Study of how often `adaptive` reports a strip unlike its model, rightly and wrongly.

Strips as they may come are compared with a rod of what the policy believed at the touch
(`cell.perception.model_agreement`). Laws that no description of a strip has are causes
of the exam.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cell.base.config.unmeasured_strip import unmeasured_strip
from cell.perception.model_agreement import MeasuredFold, agreement
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.engine import Observables, Stepper
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.twin.chain.engine import Chain
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.policy import Decision, FoldPrediction, Observation
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGE_SENSING
from policies.strip_sampling import (
    STRIP_LENGTH,
    draw_effect,
    draw_friction,
    plain_strip,
    random_strip,
)
from tests.lab.exam.causes import cause_of
from tests.lab.studies.study import (
    Fit,
    Outcome,
    Quantity,
    Statistic,
    Study,
    Values,
    percentage,
)

LINKS = 80
# of the folds that behave like the model are not flagged, by each limit
UNFLAGGED_SHARE = 0.99
TRAINED_CONDITIONS = (
    "as they come",
    "friction 20-60",
    "seam",
    "3 mm noise",
    "latency +-10 ms",
)
STRANGE_LAWS = {
    "draught 0.35 m/s": ("draught", {"speed": 0.35}),
    "draught 0.55 m/s": ("draught", {"speed": 0.55}),
    "Dahl friction 60": ("dahl", {"yield_curvature": 60.0}),
    "softening bending": ("sinh_bending", {"cubic": -2e-4}),
    "stiffening bending": ("sinh_bending", {"cubic": 1e-3}),
}


IMAGES = {
    "3 mm noise": replace(
        IMAGE_SENSING, contact_sigma=0.003, tip_sigma=0.003, profile_sigma=0.003
    ),
    "latency +-10 ms": replace(IMAGE_SENSING, delay_error=0.01),
}
"""Simulated sensing in the conditions of its own."""


class Kept(Adaptive):
    """Policy `adaptive` for one strip that keeps every observation and the prediction
    after it.
    """

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Discard the observations of the last fold."""
        super().reset(strip, speed, count)
        self.seen: list[tuple[Observation, FoldPrediction]] = []

    def decide(self, observation: Observation) -> Decision:
        """Decide, and keep observation and prediction."""
        decision = super().decide(observation)
        judged = self._recent[-1]
        d, sigma, belief = (
            judged.displacement[0],
            judged.sigma[0],
            judged.belief.first(),
        )
        prediction = FoldPrediction(float(d), float(sigma), **belief, blind=False)
        self.seen.append((observation, prediction))
        return decision


class Traced:
    """Engine wrapper that records the grippers' motion: `times` (k,) [s], `poses` (k,
    n, 3).
    """

    def __init__(self, engine: Stepper) -> None:
        self._engine = engine
        self.times: list[float] = []
        self.poses: list[Array] = []

    def reset(self, models: Sequence[StripModel]) -> None:
        """Start a new recording."""
        self._engine.reset(models)
        self.times, self.poses = (
            [0.0],
            [np.tile((STRIP_LENGTH, 0.0, 0.0), (len(models), 1))],
        )

    def step(self, poses: Array, dt: float) -> Observables:
        """Step the engine to `poses` (n, 3) in `dt` [s], and record that."""
        self.times.append(self.times[-1] + dt)
        self.poses.append(poses.copy())
        return self._engine.step(poses, dt)

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] of the engine."""
        return self._engine.shapes()

    def arc(self) -> Array:
        """Arc lengths (n, nodes) [m] of the engine."""
        return self._engine.arc()


def rough(low: float, high: float) -> Callable[[np.random.Generator], StripFile]:
    """Make a draw function of strips with yarn friction, its yield curvature in a range
    [1/m].
    """
    return lambda rng: plain_strip(
        rng, bending_hysteresis=draw_friction(rng, low, high)
    )


def add_seam(rng: np.random.Generator) -> StripFile:
    """Draw a strip with a seam at a random place."""
    return plain_strip(rng, seam=draw_effect("seam", rng))


STRIP_DRAWS: dict[str, Callable[[np.random.Generator], StripFile]] = {
    "friction 20-60": rough(20.0, 60.0),
    "friction 90": rough(90.0, 90.1),
    "stretch 3 N": lambda rng: plain_strip(rng, stretch={"stiffness": 3.0}),
    "seam": add_seam,
    **dict.fromkeys(STRANGE_LAWS, plain_strip),
}
CONDITIONS = (*TRAINED_CONDITIONS, "friction 90", "stretch 3 N", *STRANGE_LAWS)


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a strip in the next of the conditions, as trained or outside."""
    name = CONDITIONS[number % len(CONDITIONS)]
    strip = STRIP_DRAWS.get(name, random_strip)(rng)
    content = strip.model_dump(mode="json", by_alias=True)
    kind = "as trained" if name in TRAINED_CONDITIONS else "outside"
    return {"kind": kind, "condition": name, "strip": content, "noise": number}


def measure(case: Values) -> Values:
    """Displacement d [m] of a fold, whether it was flagged, and the residual [m] of the
    rod.
    """
    strip = StripFile.model_validate(case["strip"])
    law = STRANGE_LAWS.get(case["condition"])
    causes = [] if law is None else [cause_of(*law)]
    forces = [partial(cause.begin, rng=np.random.default_rng(0)) for cause in causes]
    engine, policy = Traced(Chain(LINKS, forces)), Kept(load_critic())
    settings = Rollout(sensing=IMAGES.get(case["condition"], IMAGE_SENSING))
    rng = np.random.default_rng([case["noise"], 1])
    folds = roll_out(
        policy, engine, strip, [describe(strip)], settings=settings, rng=rng
    )
    touch, d = folds.touch[0], float(folds.displacement[0])
    if touch is None:
        return {"d": None, "flagged": None, "residual": None}
    decisions = [seen for seen in policy.seen if seen[0].time[0] <= touch.time]
    stamps = np.array([observation.stamp[0] for observation, _ in decisions])
    # decisions by an image not seen before
    new = np.concatenate([[True], np.diff(stamps) > 0])
    curves = np.array([observation.profile[0] for observation, _ in decisions])
    path = np.array(engine.poses)[:, 0]
    fold = MeasuredFold.until(
        touch.time, np.array(engine.times), path, stamps[new], curves[new]
    )
    agreed = agreement(unmeasured_strip(str(STRIP_LENGTH)), decisions[-1][1], fold)
    if agreed is None:
        return {"d": d, "flagged": None, "residual": None}
    return {
        "d": d,
        "flagged": not agreed.like_model,
        "residual": agreed.residual,
        "yield_curvature": agreed.yield_curvature,
    }


def limits(outcomes: Sequence[Outcome]) -> Values:
    """Limits of residual [m] and curvature [1/m] that UNFLAGGED_SHARE of ordinary folds
    keep.
    """
    rows = [o.values for o in outcomes if o.case.values["kind"] == "as trained"]
    rows = [row for row in rows if row["residual"] is not None]
    found = {
        name: float(np.quantile([row[name] for row in rows], UNFLAGGED_SHARE))
        for name in ("residual", "yield_curvature")
    }
    return {"schema": 1, **found, "share": UNFLAGGED_SHARE, "folds": len(rows)}


STUDY = Study(
    name="agreement",
    question=(
        "How often is a strip said not to behave like the model, rightly and wrongly?"
    ),
    draw=draw,
    measure=measure,
    by=("kind", "condition"),
    quantities=(
        percentage("flagged", "flagged"),
        Quantity("residual", Statistic.MEDIAN, label="median residual"),
        Quantity("residual", Statistic.WORST_SIZE, label="worst residual"),
        Quantity("d", Statistic.MEAN_SIZE, label="mean |d|"),
    ),
    fits=(Fit("cell/perception/model_agreement.yaml", limits),),
    usual=40 * len(CONDITIONS),
    quick=1,
    seconds=4.0,
)
