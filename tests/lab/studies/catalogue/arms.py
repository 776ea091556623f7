"""Study of folds through the robot's own library beside the in-process arm, each repeated."""

from pathlib import Path
from tempfile import TemporaryDirectory

from tests.lab.studies.kit.folds import difference, fold_strip, next_strip
from tests.lab.studies.study import Quantity, Statistic, Study, Values

FILES = ("ticks.parquet", "profile.parquet", "result.yaml")


def measure(case: Values) -> Values:
    """Difference of true displacements [m] by both arms, and whether a repeat has equal bytes."""
    with TemporaryDirectory() as place:
        arms = ("fci", "fci", "twin")
        made = [
            fold_strip(case["strip"], "triangular", case["noise"], Path(place) / str(i), arm=arm)
            for i, arm in enumerate(arms)
        ]
        first, again = ([(Path(m.run) / name).read_bytes() for name in FILES] for m in made[:2])
    fci, twin = made[0].displacement_true, made[2].displacement_true
    return {"fci": fci, "apart": difference(fci, twin), "same": first == again,
            "pace": made[0].wall / made[0].duration}  # fmt: skip


STUDY = Study(
    name="arms",
    question="Does a fold through the robot's library end like one by the in-process arm?",
    draw=next_strip,
    measure=measure,
    by=("strip",),
    quantities=(
        Quantity("apart", Statistic.WORST_SIZE, label="|difference of d|", bar=1.5),
        Quantity("same", Statistic.SHARE, "%", 100.0, bar=100.0, floor=True, label="same bytes",
                 digits=0),
        Quantity("pace", Statistic.MEDIAN, "1", 1.0, label="wall / duration", digits=1),
    ),
    usual=10,
    quick=1,
    seconds=45.0,
)  # fmt: skip
