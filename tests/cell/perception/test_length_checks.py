"""Sources of one length that disagree are doubted or refuted by their spread, and
said.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.folding.documents import result_content
from cell.folding.fold import _warning
from cell.gap.report.sentence import capitalised
from cell.perception.length_checks import (
    DOUBTED,
    LENGTHS,
    REFUTED,
    LengthCheck,
    compare_grip,
    disagreements,
    doubts,
    held_end_offset,
)
from cell.record.header import Result
from cell.record.run import read_run
from cell.report.page_verdict import verdict_of
from tests.support.made_folds import OUTCOME, SEEN
from tests.support.made_results import DONE


def off_by(spreads: float) -> LengthCheck:
    return LengthCheck("grip", -0.001 * spreads, 0.001)


def test_what_differs_by_more_than_its_spread_allows_is_doubted_then_refuted() -> None:
    sizes = [DOUBTED - 0.1, DOUBTED + 0.1, REFUTED - 0.1, REFUTED + 0.1]
    witnesses = [off_by(size) for size in sizes]
    assert disagreements(witnesses) == tuple(reversed(witnesses[1:]))
    assert disagreements(witnesses, REFUTED) == (witnesses[3],)


def test_a_displacement_is_doubted_from_three_spreads_on_the_cells_lengths_from_four():
    names = "displacement", *LENGTHS
    witnesses = [LengthCheck(name, 0.0035, 0.001) for name in names]
    assert [*doubts(witnesses)] == ["displacement"]


def test_held_end_is_one_witness_by_the_images_that_show_it_close_to_the_gripper():
    held = replace(
        SEEN, profile=np.array([(0.3, 0.1), (0.304, 0.2)]), gripper=(0.3, 0.204)
    )
    hidden = replace(held, gripper=(0.3, 0.23)), replace(held, profile=held.profile[:0])
    offsets = [held_end_offset(seen) for seen in (held, *hidden)] + [0.004] * 8
    assert compare_grip(offsets, 0.0003) == ()
    (witness,) = compare_grip([*offsets, 0.2], 0.0003)
    assert witness.difference == pytest.approx(0.004)
    assert disagreements([witness]) == (witness,)


def test_a_disagreement_stands_on_the_terminal_in_json_in_the_record_and_on_the_page(
    finished: Path,
) -> None:
    late = LengthCheck("displacement", 0.0059, 0.001)
    outcome = replace(OUTCOME, agreement=None, witnesses=(late, off_by(1.0)))
    said = (
        "displacement: camera and prediction differ by +5.9 mm, 6 times the usual"
        " 1.0 mm"
    )
    result = replace(DONE, witnesses=outcome.witnesses, warning=_warning(outcome, ""))
    assert said in str(result)
    assert "grip" not in str(result)
    assert result.line()["witnesses"][0] == {
        "name": "displacement",
        "difference": 0.0059,
        "spread": 0.001,
    }
    content = {"schema": 1, **result_content(outcome)}
    run = replace(read_run(finished), result=Result.model_validate(content))
    sentences = verdict_of(run).sentences
    assert any(sentence.startswith(capitalised(said)) for sentence in sentences)
    assert "grip" not in str(sentences).lower()


@pytest.mark.parametrize(
    ("cause", "shares"),
    [
        ("map is +9.0 mm off", (1, 1, -2)),
        ("strip is held +9.0 mm", (0, 1, -1)),
        ("free edge lies +9.0 mm", (1, 0, 0)),
    ],
)
def test_lengths_together_name_what_is_off_and_by_how_much(cause, shares) -> None:
    off = [
        LengthCheck(n, 0.009 * a, 0.001) for n, a in zip(LENGTHS, shares, strict=True)
    ]
    [reason] = set(doubts(off).values())
    assert cause in reason.split("; ")[1]
