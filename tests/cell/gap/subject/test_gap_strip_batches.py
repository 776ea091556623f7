"""Which motions of a strip are simulated together."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np

from cell.gap.subject.strip.scope import candidate, file_values
from cell.gap.subject.strip.simulation import (
    LANE_COUNT,
    HashedModel,
    HashedPath,
    Job,
    _split_by_terms,
)
from cell.gap.subject.strip.subject import AGEING
from drivers.strip.describe import describe, load_strip
from drivers.strip.effects import registry
from drivers.strip.law import LAW_TERMS, with_law
from drivers.strip.rod.lumping import needs_terms
from drivers.strip.rod.motions import GripperPath

STRIP = load_strip(Path("configs/strips/denim.yaml"))


def jobs(plain: int, rich: int) -> dict[bytes, Job]:
    """Motions along paths of unlike durations, those that need further terms among the others."""
    drag = {"air_drag": {"coefficient": 1.0}}
    models = [HashedModel.of(describe(STRIP, known)) for known in ({}, drag)]
    which = [False] * plain + [True] * rich
    order = np.random.default_rng(1).permutation(len(which))
    found = []
    for k in order:
        path = HashedPath.of(GripperPath(np.array([0.0, 1.0 + 0.1 * k]), np.zeros((2, 3))))
        found.append(Job.of(models[which[k]], path, 0.001))
    return {job.key: job for job in found}


def test_strips_that_need_further_terms_are_simulated_apart_from_plain_ones() -> None:
    wanted = jobs(plain=2 * LANE_COUNT, rich=LANE_COUNT)
    parts = _split_by_terms(list(wanted), wanted)
    assert [len(part) for part in parts] == [LANE_COUNT, 2 * LANE_COUNT]
    for part in parts:
        assert len({needs_terms(wanted[key].model) for key in part}) == 1
        assert part == [key for key in wanted if key in part]


def test_a_few_strips_do_not_make_a_batch_of_their_own() -> None:
    wanted = jobs(plain=2 * LANE_COUNT, rich=LANE_COUNT - 1)
    assert _split_by_terms(list(wanted), wanted) == [list(wanted)]


def test_only_what_ages_depends_on_the_number_of_the_run() -> None:
    def depends(amounts: dict[str, dict[str, float]], law: dict[str, float]) -> bool:
        seen = [with_law(describe(STRIP, amounts, index), law) for index in (0, 9)]
        fresh, worn = (pickle.dumps(replace(model, index=0)) for model in seen)
        return fresh != worn

    for name, effect in registry().items():
        values = file_values(effect, candidate(effect, STRIP, 0.0).probes[-1][0])
        assert depends({name: values or {}}, {}) is (name in AGEING), name
    for name in LAW_TERMS:
        assert depends({}, {name: 0.01}) is (name in AGEING), name
