"""Small cases and verdicts for the tests of the exam."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cell.gap.verdict.schema import Interval, NamedEffect, Verdict
from tests.lab.exam.case import Case
from tests.support.fit_folders import verdict_of
from tests.support.gap_strip_cases import folds, written

Numbers = tuple[float, float | None, float | None]


def case(
    name: str, kind: Any, effects: dict[str, dict[str, float]], **changes: Any
) -> Case:
    """Exam case of denim whose `effects` are the answer."""
    facts: dict[str, Any] = {
        "tier": "state",
        "strip": "denim",
        "seed": 1,
        "answer": (*effects,),
    }
    return Case(name=name, kind=kind, effects=effects, **{**facts, **changes})


def verdict(
    said: Any,
    effects: Sequence[NamedEffect] = (),
    classes: Sequence[list[str]] = (),
    base: dict[str, Numbers] | None = None,
    unit: float = 1.0,
) -> Verdict:
    """Verdict for tests, with base values in multiples of `unit`."""
    scaled = {
        name: Interval(value=unit * v, low=unit * (low or 0), high=unit * (high or 0))
        for name, (v, low, high) in (base or {}).items()
    }
    lists = {"effects": list(effects), "ambiguous": list(classes)}
    gap = verdict_of().gap.model_copy(update={"before": {"excess": 2.5}})
    return verdict_of(verdict=said, base=scaled, gap=gap, **lists)


def named(
    *names: str, parameters: dict[str, Numbers] | None = None, confidence: float = 0.9
) -> Verdict:
    """Verdict that names the effects `names`."""
    values = {
        key: Interval(value=v, low=low, high=high, unit="")
        for key, (v, low, high) in (parameters or {}).items()
    }
    effects = [
        NamedEffect(name=n, of="strip", parameters=values, confidence=confidence)
        for n in names
    ]
    return verdict("named", effects)


def few_runs(case: Case, folder: Path) -> None:
    """Write two folds of the case's plant, simulated by the rod, into `folder`."""
    written(folder, folds(("normal", "fast"), case.effects), seed=case.seed)
