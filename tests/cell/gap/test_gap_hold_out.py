"""Which runs only judge."""

import pytest

from cell.gap.selection.hold_out import held_out
from drivers.base.types import Array
from tests.support.curves import LAWS, Curves, bump, nothing


def medium_only(t: Array, speed: float, _: int) -> Array:
    return bump(t, speed, 0) * (speed == 1.0)


def conditions(subject: Curves) -> set[str]:
    held = held_out(subject, subject.simulate)
    return {run.condition for run in subject.runs if run.name in held}


def test_one_condition_in_four_is_held_out_with_all_its_repeats() -> None:
    subject = Curves(nothing, repeats=3)
    assert conditions(subject) == {"medium"}
    assert len(held_out(subject, subject.simulate)) == 3


def test_a_condition_that_alone_tells_an_effect_is_fitted_and_one_of_its_repeats_judges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(LAWS, "single", medium_only)  # type: ignore[misc]
    assert conditions(Curves(nothing, names=("bump", "single"), repeats=1)) == {"fast"}
    subject = Curves(nothing, names=("bump", "single"))
    medium = [run.name for run in subject.runs if run.condition == "medium"]
    held = held_out(subject, subject.simulate)
    assert set(held) & set(medium) == {medium[-1]}
    assert conditions(subject) == {"medium", "fast"}


def test_runs_that_were_asked_for_are_held_out() -> None:
    subject = Curves(nothing)
    assert held_out(subject, subject.simulate, ["r3", "r0", "r3"]) == ["r3", "r0"]
