"""The study of mechanisms: what counts as right, and what cannot be found is not drawn."""

from typing import Any

import numpy as np
import pytest

from cell.gap.verdict.schema import NamedEffect, ValueWithUnit, Verdict
from tests.lab.studies.catalogue.mechanisms import STUDY, coverage, score


def verdict(kind: str, *names: str, ambiguous: Any = ()) -> Verdict:
    size = {"torque_j1": ValueWithUnit(value=1.0, low=0.8, high=1.2, unit="N m")}
    named = [NamedEffect(name=n, of="model", parameters=size, confidence=0.9) for n in names]
    return Verdict.model_construct(verdict=kind, effects=named, ambiguous=list(ambiguous))


@pytest.mark.parametrize(
    ("hidden", "found", "right", "by_class", "wrong"),
    [
        ("nothing", verdict("no_gap"), True, True, False),
        ("nothing", verdict("ambiguous", ambiguous=[["a", "b"]]), False, False, False),
        ("loose_bolt", verdict("unexplained", ambiguous=[["a", "b"]]), True, True, False),
        ("loose_bolt", verdict("ambiguous", ambiguous=[["a", "b"]]), False, False, True),
        ("loose_bolt", verdict("no_gap"), False, False, False),
        ("payload", verdict("named", "payload"), True, True, False),
        ("payload", verdict("ambiguous", ambiguous=[["payload", "b"]]), False, True, False),
        ("payload", verdict("named", "payload", "b"), False, False, True),
    ],
)
def test_a_verdict_is_scored(hidden, found, right, by_class, wrong) -> None:
    assert score(hidden, found) == {"right": right, "by_class": by_class, "wrong": wrong}


def test_sizes_are_covered_where_their_intervals_hold_them() -> None:
    found = verdict("named", "dry_friction")
    assert coverage("dry_friction", {"torque_j1": 1.1}, found) == [True]
    assert coverage("dry_friction", {"torque_j1": 1.3}, found) == [False]
    assert coverage("payload", {"mass": 1.0}, found) == []


def test_a_link_is_bent_where_joints_turn_out_of_one_plane_alone() -> None:
    cases = [STUDY.draw(number, np.random.default_rng(number)) for number in range(240)]
    bent = [case for case in cases if case["hidden"] == "bent_link"]
    assert bent
    assert not any(case["cart"] for case in bent)
    assert any(case["cart"] for case in cases)
