"""What to do after a fit is decided once: command, page and acceptance say the same."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from cell.gap.subject.subject import Origin
from cell.gap.verdict.decision import GAP, OFFERED, next_steps
from cell.gap.verdict.findings import DecidedVerdict
from cell.gap.verdict.schema import NamedEffect, Step, Unexplained, VerdictEvidence

EFFECT = NamedEffect(name="wave", of="strip", parameters={}, confidence=0.4)
LAW = Unexplained(description="", law="+3 m x speed", stable=True)
NO_LAW = Unexplained(description="", law="no sparse law found", stable=False)
OUT = Path("my runs/out")


def steps(
    kind: str, *, unseen: float = 0.0, option="--strip x.yaml", ends=None, **found
) -> list:
    """Steps after a verdict of a kind, with the effects, law or values `found`."""
    empty = dict.fromkeys(("effects", "suspected", "deviates", "unexplained"), ())
    verdict = SimpleNamespace(**(empty | found))
    evidence = VerdictEvidence(left=1.0, correlation=0.0)
    accepted = {e.name: 0.4 for e in [*verdict.effects, *verdict.suspected]}
    decision = DecidedVerdict(kind, (), accepted, evidence, "", ends or {}, unseen)
    return next_steps(decision, verdict, OUT, Origin(option))


@pytest.mark.parametrize(
    ("kind", "found", "expected"),
    [
        ("named", {"effects": [EFFECT]}, ["accept"]),
        ("named", {"effects": [EFFECT], "suspected": [EFFECT]}, ["accept"]),
        ("no_gap", {"deviates": [1]}, ["accept_values"]),
        ("no_gap", {"unseen": 2 * GAP}, ["repeat"]),
        ("no_gap", {}, ["fold"]),
        ("no_gap", {"option": "--model arm.yaml"}, ["none"]),
        ("ambiguous", {}, ["advise"]),
        ("ambiguous", {"suspected": [EFFECT]}, ["advise", "accept_suspected"]),
        ("unexplained", {"unexplained": NO_LAW}, ["look"]),
        ("unexplained", {"unexplained": LAW}, ["accept_law"]),
        (
            "unexplained",
            {"unexplained": LAW, "suspected": [EFFECT]},
            ["look", "accept_suspected", "accept_law"],
        ),
        (
            "unexplained",
            {"unexplained": NO_LAW, "deviates": [1]},
            ["accept_values", "look"],
        ),
    ],
)
def test_each_verdict_is_followed_by_its_steps(kind, found, expected) -> None:
    assert [step.kind for step in steps(kind, **found)] == expected


def test_what_is_less_probable_than_not_is_never_the_advised_step() -> None:
    first, force, _ = steps("unexplained", unexplained=LAW, suspected=[EFFECT])
    assert not first.command
    assert force.command == "cell gap accept 'my runs/out' --strip x.yaml --force"
    assert "wave, 40 % probable" in force.words


@pytest.mark.parametrize(
    ("p", "ends"), [(0.9 * OFFERED, {}), (0.9, {"wave": ["size"]})]
)
def test_what_is_improbable_or_at_the_end_of_what_is_tried_is_not_offered(
    p: float, ends: dict[str, list[str]]
) -> None:
    suspect = EFFECT.model_copy(update={"confidence": p})
    found = steps("unexplained", unexplained=NO_LAW, suspected=[suspect], ends=ends)
    assert [step.kind for step in found] == ["look"]


def test_a_step_reads_as_a_sentence_with_its_command_in_code() -> None:
    assert Step("advise", "cell gap advise out", "says which").sentence == (
        "`cell gap advise out` says which"
    )
    assert Step("none", "", "nothing to accept").sentence == "nothing to accept"
