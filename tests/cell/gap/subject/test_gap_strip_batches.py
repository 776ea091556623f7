"""Which motions of a strip are simulated together."""

from pathlib import Path

import numpy as np

from cell.gap.subject.strip.simulation import LANES, Job, _apart
from drivers.strip.describe import describe, load_strip
from drivers.strip.rod.lumping import needs_terms
from drivers.strip.rod.motions import GripperPath

STRIP = load_strip(Path("configs/strips/denim.yaml"))


def jobs(plain: int, rich: int) -> dict[bytes, Job]:
    """Motions along paths of unlike durations, those that need further terms among the others."""
    drag = {"air_drag": {"coefficient": 1.0}}
    models = [describe(STRIP), describe(STRIP, drag)]
    which = [False] * plain + [True] * rich
    order = np.random.default_rng(1).permutation(len(which))
    found = []
    for k in order:
        way = GripperPath(np.array([0.0, 1.0 + 0.1 * k]), np.zeros((2, 3)))
        found.append(Job.of(models[which[k]], way))
    return {job.key: job for job in found}


def test_strips_that_need_further_terms_are_simulated_apart_from_plain_ones() -> None:
    wanted = jobs(plain=2 * LANES, rich=LANES)
    parts = _apart(list(wanted), wanted)
    assert [len(part) for part in parts] == [LANES, 2 * LANES]
    for part in parts:
        assert len({needs_terms(wanted[key].model) for key in part}) == 1
        assert part == [key for key in wanted if key in part]


def test_a_few_strips_do_not_make_a_batch_of_their_own() -> None:
    wanted = jobs(plain=2 * LANES, rich=LANES - 1)
    assert _apart(list(wanted), wanted) == [list(wanted)]
