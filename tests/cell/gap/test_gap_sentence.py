"""What the one sentence on top of the report tells besides the effect."""

from dataclasses import replace

import numpy as np

from cell.gap.report.sentence import sentence
from cell.gap.verdict.findings import Findings
from tests.cell.gap.test_gap_engine import Curves, bump, hidden, judged


def with_size(found: Findings, size: float) -> Findings:
    """The same findings, with another size of the accepted effect."""
    accepted = found.accepted
    point = accepted.estimate.point
    moved = replace(point, shared=np.append(point.shared[:-1], size))
    model = replace(accepted, estimate=replace(accepted.estimate, point=moved))
    return replace(found, choice=replace(found.choice, accepted=model))


def test_a_value_that_a_bound_stopped_is_told() -> None:
    found, verdict = judged(Curves(hidden(bump, 0.3)))
    assert "perhaps beyond" not in sentence(found, verdict)
    assert "perhaps beyond: bump size" in sentence(with_size(found, 5.0), verdict)
