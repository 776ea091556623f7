"""Study of the gap that the exam's causes leave on a strip: the source of their sizes.

A chain of 100 links with the cause goes through the motions of a case from the state, measured as a
cell does; the gap is what the workflow's refitted base leaves on held-out runs: about 2.5 for a
medium cause, 6 for a strong one. What the workflow says is no criterion.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.gap.fit import fit
from cell.gap.subject.strip.synthetic import Fold, Instruments, reported_path, write_fold
from drivers.strip.describe import describe
from drivers.strip.engine import simulate
from policies.experiments.standard import STANDARD
from policies.registry import MOTION
from tests.lab.exam.causes import cause_of, causes
from tests.lab.exam.from_state import MOTIONS, Specimen
from tests.lab.studies.study import Quantity, Statistic, Study, Values

LINKS, STEP = 100, 0.004
BY = Instruments(contact_x=0.0015, profile=0.001, rate=60.0)
SIZES = [(name, size) for name, cause in sorted(causes().items()) for size in cause.sizes]


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all causes and sizes on denim, then on other strips."""
    strips = find_configs(None).strip_names()
    turn, which = divmod(number, len(SIZES))
    name, size = SIZES[which]
    strip = strips[(strips.index("denim") - turn) % len(strips)]
    values = dict(causes()[name].sizes[size])
    return {"cause": name, "size": size, "values": values, "strip": strip, "noise": turn}


def measure(case: Values) -> Values:
    """Excess gap of the refitted base, and its parts in profile and contact [m]."""
    known = find_configs(None).strip(case["strip"])
    rng = np.random.default_rng(1 + case["noise"])
    with TemporaryDirectory() as place:
        runs = Path(place) / "runs"
        for index, motion in enumerate(MOTIONS):
            path = reported_path(STANDARD[motion].of(known.length))
            plant = Specimen(LINKS, [cause_of(case["cause"], case["values"])], 7)
            model = describe(known, {}, index)
            moved = simulate(plant, model, path.t, path.poses, dt=STEP, shapes=True)
            arc = np.linspace(0.0, known.length, moved.shapes.shape[1])
            fold = Fold(path, model, moved, moved.t, arc, index, MOTION + motion)
            write_fold(runs / f"{index:02d}-{motion}", known.name, fold, BY, rng)
        strip_file = find_configs(None).strip_path(case["strip"])
        gap = fit([runs], strip_file, Path(place) / "out").gap.before
    return {"excess": gap["excess"], "profile": 1e-3 * gap["profile_mm"],
            "contact": 1e-3 * gap["contact_x_mm"]}  # fmt: skip


STUDY = Study(
    name="causes",
    question="What gap do the causes of the exam leave, by their sizes?",
    draw=draw,
    measure=measure,
    by=("cause", "size"),
    quantities=(
        Quantity("excess", Statistic.MEAN, "", 1.0, label="excess gap"),
        Quantity("profile", Statistic.MEAN, label="profile"),
        Quantity("contact", Statistic.MEAN, label="contact"),
    ),
    usual=len(SIZES),
    quick=1,
    seconds=30.0,
)
