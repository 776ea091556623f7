"""What perception gets wrong alike in all runs: means over half a run of what images say less the
truth.

The gap workflow takes their root mean square over strips for an error that is common to all runs
(`cell.gap.subject.strip.bias`).
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from cell.config.places import find_configs
from cell.gap.subject.strip.bias import HALVES, half
from cell.gap.subject.strip.phases import zones
from cell.report.statistic import Quantity, Statistic
from cell.studies.kit.sights import Sight, fold_of, sights
from cell.studies.study import Fit, Outcome, Study, Values
from policies.experiments.standard import FIRST, STANDARD

EVERY = 5  # images, of which one is looked at until shortly before the touch


def draw(number: int, _rng: np.random.Generator) -> Values:
    """The next strip of the cell."""
    strips = find_configs(None).strip_names()
    return {"strip": strips[number % len(strips)]}


def measure(case: Values) -> Values:
    """Mean errors [m, s] of a standard fold's images by quantity, third of the strip and half."""
    motion, strip = STANDARD[FIRST], find_configs(None).strip(case["strip"])
    errors: dict[str, list[float]] = defaultdict(list)
    for sight in sights(fold_of(strip.name, motion.shape(strip.length), motion.speed), EVERY):
        if sight.touch is not None and sight.fold.touch is not None:
            true = sight.fold.touch
            errors["touch_time"].append(sight.touch.time - true.time)
            errors["displacement"].append(sight.touch.displacement - true.displacement)
        else:
            _add(errors, sight, strip.length)
    return {name: float(np.nanmean(values)) for name, values in errors.items()}


def _add(errors: dict[str, list[float]], sight: Sight, length: float) -> None:
    """Add what one image says of contact and profile, less the truth."""
    side = half(sight.pose.x, length)
    errors[f"contact_x {side}"].append(sight.contact)
    if len(sight.seen.profile):
        off, where = sight.profile()
        labels = zones(where * length, length)
        for zone in np.unique(labels):
            errors[f"profile {zone} {side}"].append(float(np.median(off[labels == zone])))


def sizes(outcomes: Sequence[Outcome]) -> Values:
    """Root mean squares over strips; of the profile beside the near edge, which shows on the other
    side past the middle. l1 and l2 err alike, so that a touch's place errs by half as much as the
    displacement.
    """
    rows = [o.values for o in outcomes]
    before, past = (_all(rows, "profile", name) for name in HALVES)
    edge = float(np.mean([*past, *(-before)])) if len(before) and len(past) else 0.0
    rms = {name: _rms(_all(rows, name)) for name in ("contact_x", "touch_time", "displacement")}
    profile = _rms(np.concatenate([before + edge, past - edge]))
    return {"schema": 1, "edge": edge, "profile": profile, **rms,
            "touch_x": rms["displacement"] / 2, "strips": len(rows)}  # fmt: skip


def _all(rows: Sequence[Values], quantity: str, side: str = "") -> np.ndarray:
    """Every mean (n,) of a quantity, of one half of the runs or of both."""
    return np.array(
        [v for row in rows for k, v in row.items() if k.startswith(quantity) and k.endswith(side)]
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


STUDY = Study(
    name="biases",
    question="What does perception get wrong alike in all runs?",
    draw=draw,
    measure=measure,
    by=("strip",),
    quantities=(
        Quantity("contact_x before", Statistic.MEAN, label="contact before the middle", digits=2),
        Quantity("contact_x past", Statistic.MEAN, label="past it", digits=2),
        Quantity("displacement", Statistic.MEAN, label="d at the touch", digits=2),
        Quantity("touch_time", Statistic.MEAN, "ms", label="touch", digits=1),
    ),
    fit=Fit("cell/gap/subject/strip/bias.yaml", sizes),
    usual=10,
    quick=1,
    seconds=15.0,
)
