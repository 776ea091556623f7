"""Study of how often `adaptive` reports a strip unlike its model, rightly and wrongly.

Strips as they may come are compared with a rod of what the policy believed at the touch
(`cell.perception.model_agreement`). Laws that no description of a strip has are causes
of the exam.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cell.base.config.unmeasured_strip import unmeasured_strip
from cell.perception.model_agreement import MeasuredFold, agreement
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.twin.chain.engine import Chain
from policies.adaptive.checkpoint import load_critic
from policies.rollout import Rollout, roll_out
from policies.strip_sampling import STRIP_LENGTH, draw_effect, plain_strip, random_strip
from tests.lab.exam.causes import cause_of
from tests.lab.studies.kit.rollouts import Kept, Traced, rough, sensing_of, stretchy
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


def add_seam(rng: np.random.Generator) -> StripFile:
    """Draw a strip with a seam at a random place."""
    return plain_strip(rng, seam=draw_effect("seam", rng))


STRIP_DRAWS: dict[str, Callable[[np.random.Generator], StripFile]] = {
    "friction 20-60": rough(20.0, 60.0),
    "friction 90": rough(90.0, 90.1),
    "stretch 3 N": stretchy,
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
    settings = Rollout(sensing=sensing_of(case["condition"]))
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
