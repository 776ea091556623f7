"""Study of how well the gap workflow estimates the run-to-run spreads.

Nothing is hidden, and runs differ at a level of the exam. Estimates are over the true spreads, and
over what the drawn runs happen to have.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.gap.fitting.model import Model, evidence
from cell.gap.fitting.reml import spreads
from cell.gap.fitting.starts import refit_base
from cell.gap.opening import open_subject
from cell.gap.subject.run_folders import find_runs
from tests.lab.exam.case import Case
from tests.lab.exam.cases import SLOWER, STIFFER
from tests.lab.exam.from_state import LEVELS, MOTIONS, RunScatter, make_runs
from tests.lab.studies.study import Quantity, Statistic, Study, Values

QUANTITIES = ("grip_x", "grip_z", "damping", "stiffness")
SCATTER_CYCLE = ("full", "half")


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a plant without hidden effects whose runs differ at the next level of scatter."""
    case = Case(
        name=f"spread-{number:03d}",
        tier="state",
        kind="nothing",
        strip=str(rng.choice(find_configs(None).strip_names())),
        seed=int(rng.integers(2**31)),
        stiffness=float(STIFFER ** rng.uniform(-1, 1)),
        damping=float(SLOWER ** rng.uniform(-1, 1)),
        scatter=SCATTER_CYCLE[number % len(SCATTER_CYCLE)],
    )
    return {"level": case.scatter, "case": case.model_dump(mode="json")}


def measure(case: Values) -> Values:
    """Estimated spreads over true and over drawn ones, and names of other spreads found."""
    plant = Case.model_validate(case["case"])
    found, level = _estimate(plant), LEVELS[plant.scatter]
    runs = [RunScatter.draw(plant.scatter, plant.seed, i) for i in range(len(MOTIONS))]
    each = np.array([[*run.grip, run.damping, run.stiffness] for run in runs])
    stated = dict(zip(QUANTITIES, (level.grip, level.grip, level.damping, level.stiffness),
                      strict=True))  # fmt: skip
    drawn = dict(zip(QUANTITIES, each.std(axis=0, ddof=1).tolist(), strict=True))
    return {
        **{name: found.get(name, 0.0) / stated[name] for name in QUANTITIES},
        **{f"{name}_drawn": found.get(name, 0.0) / drawn[name] for name in QUANTITIES},
        "others": sorted(set(found) - set(QUANTITIES)),
    }


def _estimate(case: Case) -> dict[str, float]:
    """Run-to-run spreads by name, estimated from the runs of a case beside the refitted base."""
    with TemporaryDirectory() as name:
        make_runs(case, Path(name))
        file = find_configs(None).strip_path(case.strip)
        subject = open_subject(file, find_runs([Path(name)]), jobs=1)
        known = evidence(subject.runs)
        base = refit_base(subject.simulate, Model(subject.scope.base), known)
        return {spread.name: spread.value for spread in spreads(base)}


STUDY = Study(
    name="spreads",
    question="How well does the gap workflow estimate how much runs differ from one another?",
    draw=draw,
    measure=measure,
    by=("level",),
    quantities=tuple(
        Quantity(name + of, Statistic.MEDIAN, "1", 1.0, label=f"{name} over the {word}")
        for of, word in (("", "true"), ("_drawn", "drawn"))
        for name in QUANTITIES
    ),
    usual=20,
    quick=1,
    seconds=10.0,
)
