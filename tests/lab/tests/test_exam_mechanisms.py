"""The studies of mechanisms: what counts as right."""

from typing import Any

import pytest

from cell.gap.verdict.schema import NamedEffect, ValueWithUnit, Verdict
from tests.lab.studies.catalogue import foreign
from tests.lab.studies.catalogue.mechanisms import coverage, score


def verdict(kind: str, *names: str, ambiguous: Any = ()) -> Verdict:
    size = {"torque_j1": ValueWithUnit(value=1.0, low=0.8, high=1.2, unit="N m")}
    named = [NamedEffect(name=n, of="model", parameters=size, confidence=0.9) for n in names]
    return Verdict.model_construct(verdict=kind, effects=named, ambiguous=list(ambiguous),
                                   deviates=[])  # fmt: skip


@pytest.mark.parametrize(
    ("hidden", "found", "right", "by_class", "wrong"),
    [
        ("nothing", verdict("no_gap"), True, True, False),
        ("loose_bolt", verdict("unexplained", ambiguous=[["a", "b"]]), True, True, False),
        ("loose_bolt", verdict("ambiguous", ambiguous=[["a", "b"]]), False, False, True),
        ("payload", verdict("named", "payload"), True, True, False),
        ("payload", verdict("ambiguous", ambiguous=[["payload", "b"]]), False, True, False),
        ("payload", verdict("named", "payload", "b"), False, False, True),
    ],
)
def test_a_verdict_is_scored(hidden, found, right, by_class, wrong) -> None:
    assert score(hidden, found) == {"right": right, "by_class": by_class, "wrong": wrong}


@pytest.mark.parametrize(
    ("kind", "hidden", "found", "by_class", "false", "base"),
    [
        ("two effects", ["a", "b"], verdict("named", "a", ambiguous=[["b"]]), True, False, None),
        ("outside", ["x"], verdict("ambiguous", ambiguous=[["a", "b"]]), False, True, None),
        ("wrong base", ["wrong_mass"], verdict("named", "link_inertia"), True, False, True),
        ("wrong base", ["wrong_com"], verdict("named", "link_inertia"), False, True, True),
        ("wrong base", ["wrong_com"], verdict("no_gap"), False, False, False),
    ],
)
def test_models_of_others_are_scored(kind, hidden, found, by_class, false, base) -> None:
    expected = {"by_class": by_class, "false": false, "base": base}
    assert foreign.score(kind, hidden, found) == expected


def test_sizes_are_covered_where_their_intervals_hold_them() -> None:
    found = verdict("named", "dry_friction")
    assert coverage("dry_friction", {"torque_j1": 1.1}, found) == [True]
    assert coverage("dry_friction", {"torque_j1": 1.3}, found) == [False]
    assert coverage("payload", {"mass": 1.0}, found) == []
