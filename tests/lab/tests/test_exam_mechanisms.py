"""The study of mechanisms: what counts as right, and that chains come with the exam."""

from pathlib import Path
from typing import Any

import pytest

from cell.gap.verdict.schema import NamedEffect, Verdict
from tests.lab.exam.mechanisms import LISTS, open_rig
from tests.lab.studies.catalogue import mechanisms


def verdict(kind: str, *names: str, ambiguous: Any = ()) -> Verdict:
    named = [
        NamedEffect(name=n, of="model", parameters={}, confidence=0.9) for n in names
    ]
    return Verdict.model_construct(
        verdict=kind, effects=named, ambiguous=list(ambiguous), deviates=[]
    )


@pytest.mark.parametrize(
    ("kind", "hidden", "found", "by_class", "false", "counted"),
    [
        ("nothing", [], verdict("no_gap"), True, False, None),
        ("one effect", ["a"], verdict("named", "a"), True, False, None),
        (
            "one effect",
            ["a"],
            verdict("ambiguous", ambiguous=[["a", "b"]]),
            True,
            False,
            None,
        ),
        ("one effect", ["a"], verdict("named", "a", "b"), False, True, None),
        ("one effect", ["a"], verdict("no_gap"), False, False, None),
        (
            "two effects",
            ["a", "b"],
            verdict("named", "a", ambiguous=[["b"]]),
            True,
            False,
            None,
        ),
        (
            "outside",
            ["x"],
            verdict("unexplained", ambiguous=[["a", "b"]]),
            True,
            False,
            None,
        ),
        (
            "outside",
            ["x"],
            verdict("ambiguous", ambiguous=[["a", "b"]]),
            False,
            True,
            None,
        ),
        (
            "wrong base",
            ["wrong_mass"],
            verdict("named", "link_inertia"),
            True,
            False,
            True,
        ),
        (
            "wrong base",
            ["wrong_com"],
            verdict("named", "link_inertia"),
            False,
            True,
            True,
        ),
        ("wrong base", ["wrong_com"], verdict("no_gap"), False, False, False),
        ("wrong base", ["wrong_com"], verdict("no_gap"), True, False, None),
    ],
)
def test_a_verdict_is_scored(kind, hidden, found, by_class, false, counted) -> None:
    scored = mechanisms.score(kind, hidden, found, shown=counted is not None)
    assert (scored["by_class"], scored["false"], scored["base"]) == (
        by_class,
        false,
        counted,
    )


@pytest.mark.parametrize("name", LISTS["chains"])
def test_a_chain_moves_by_its_motors(name: str, tmp_path: Path) -> None:
    rig = open_rig(tmp_path, name)
    assert len(rig.driven) == int(name[-1]) == len(rig.moving())
