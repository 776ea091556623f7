"""Strips that nobody measured, drawn over the paper's range, folded by `adaptive` through images.

A cell that knows only their length folds them, with calipers also their thickness.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.report.statistic import Quantity, Statistic
from cell.studies.kit.folds import fold_unknown
from cell.studies.kit.poor_images import dropping
from cell.studies.kit.predicted import QUANTITIES, compare
from cell.studies.study import Study, Values
from drivers.strip.file import StripFile
from policies.adaptive.fabrics import EFFECTS, LENGTH, effect, friction, plain
from policies.adaptive.train.piece import truth

FRICTION = (20.0, 60.0)  # 1/m
PAIRS = ("friction+seam", "seam+stretch", "friction+hem_mass")
CONDITIONS = (
    *(("calipers", hidden) for hidden in ("nothing", "friction", *EFFECTS, *PAIRS)),
    *((known, hidden) for known in ("length alone", "half dropped") for hidden in
      ("nothing", "friction")),
)  # fmt: skip


def draw(number: int, rng: np.random.Generator) -> Values:
    """A strip in the next condition: what the cell knows or loses, and what the strip hides."""
    known, hidden = CONDITIONS[number % len(CONDITIONS)]
    parts = [part for part in hidden.split("+") if part != "nothing"]
    named = {"friction": "bending_hysteresis"}
    effects = {
        named.get(part, part): friction(rng, *FRICTION) if part == "friction" else effect(part, rng)
        for part in parts
    }
    strip = plain(rng, LENGTH, **effects)
    content = strip.model_dump(mode="json", by_alias=True)
    return {"known": known, "hidden": hidden, "strip": content, "noise": number}


def measure(case: Values) -> Values:
    """The fold, and the errors of what `adaptive` believed of the strip."""
    strip = StripFile.model_validate(case["strip"])
    measured, share = case["known"] != "length alone", 0.5 if case["known"] == "half dropped" else 0
    with TemporaryDirectory() as place:
        opened = dropping(share, case["noise"])
        result = fold_unknown(strip, case["noise"], Path(place), measured=measured, opened=opened)
        found = dict(compare(result))
    length, time, _ = truth(strip)
    if "believed_length" in found:
        found |= {
            "length_off": found["believed_length"] - length,
            "time_off": found["believed_time"] - time,
        }
    return found


STUDY = Study(
    name="unknown",
    question="How far off does `adaptive` fold strips that nobody measured, and does it say so?",
    draw=draw,
    measure=measure,
    by=("known", "hidden"),
    quantities=(
        *QUANTITIES,
        Quantity("length_off", Statistic.RMS, "%", 100.0, label="length off", digits=1),
        Quantity("time_off", Statistic.RMS, "%", 100.0, label="time off", digits=0),
    ),
    usual=10 * len(CONDITIONS),
    quick=1,
    seconds=10.0,
)
