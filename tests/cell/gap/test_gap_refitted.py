"""Which effects are refitted, and when none is."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from cell.gap.fit import quiet
from cell.gap.fitting.crossvalidation import Validated
from cell.gap.fitting.tasks import Simulate
from cell.gap.forward_selection import ForwardSelection
from cell.gap.selection import refinement, search
from cell.gap.selection.fits import Fits
from tests.cell.gap.test_gap_engine import Curves, Law, bump, hidden, judged, nothing, wave
from tests.cell.gap.test_gap_search import Bending, leaning

BASE: frozenset[str] = frozenset()


def refitted(law: Law, *, doubted: bool, further: bool = False) -> set[frozenset[str]]:
    """Sets of effects that are fitted to curves with `law`, if their base is `doubted` or not."""
    return {m.model.names for m in fitted(Curves(law), doubted=doubted, further=further).models}


def fitted(subject: Curves, *, doubted: bool, further: bool) -> Fits:
    found, _ = judged(subject)
    left = replace(found.fitted, misfit=0.0 if doubted else 1.0, places=())
    selection = ForwardSelection(subject, subject.simulate, quiet, left, found.screened)
    fits = selection.refit_singles(Fits((found.base,)))
    return selection.refit_further(fits) if further else fits


@pytest.fixture
def _one_single(monkeypatch: pytest.MonkeyPatch) -> None:
    """At first a single effect is refitted."""
    monkeypatch.setattr(search, "BUDGET", replace(search.BUDGET, singles=1))


def test_where_the_base_leaves_no_gap_only_effects_that_the_screen_shows_are_refitted() -> None:
    assert refitted(nothing, doubted=False) == {BASE}
    assert frozenset({"bump"}) in refitted(hidden(bump, 0.05), doubted=False)


def test_every_single_effect_is_tried_with_either_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[frozenset[str]] = []

    def note(_simulate: Simulate, _fits: Fits, models: Sequence[Validated]) -> list[Validated]:
        tried.extend(m.model.names for m in models)
        return []

    monkeypatch.setattr(refinement, "other_signs", note)
    fits = fitted(Curves(hidden(bump, 0.2)), doubted=False, further=False)
    assert set(tried) == {m.model.names for m in fits.of_size(1)}
    assert len(tried) > 1


def test_where_it_leaves_a_gap_effects_of_which_the_screen_expects_little_are_too() -> None:
    assert refitted(nothing, doubted=True) >= {BASE, frozenset({"bump"}), frozenset({"wave"})}


@pytest.mark.usefixtures("_one_single")
def test_other_single_effects_follow_where_a_gap_has_no_name() -> None:
    first = refitted(nothing, doubted=True)
    assert len(first) == 2
    assert refitted(nothing, doubted=False, further=True) == {BASE}
    assert len(refitted(nothing, doubted=True, further=True)) == 3


@pytest.mark.usefixtures("_one_single")
def test_a_small_second_effect_is_sought_beside_a_name_that_leaves_no_gap() -> None:
    both: Law = lambda t, s, i: 0.2 * bump(t, s, i) - 0.005 * wave(t, s, i)  # noqa: E731
    assert frozenset({"bump", "wave"}) in refitted(both, doubted=False, further=True)
    alone = refitted(hidden(bump, 0.2), doubted=False, further=True)
    assert frozenset({"bump", "wave"}) not in alone


def test_the_law_of_a_name_that_leaves_no_gap_is_refined_before_a_second_effect_is_sought() -> None:
    subject = Bending(lambda t, s, i: 0.2 * bump(t, s, i) + 0.01 * leaning(t, s, i))
    (alone, *_) = fitted(subject, doubted=False, further=False).of_size(1)
    assert [p.name for p in alone.model.effects[0].parameters] == ["size"]
    refined = fitted(subject, doubted=False, further=True).of(frozenset({"bump"}))
    assert refined is not None
    assert [p.name for p in refined.model.effects[0].parameters] == ["size", "lean"]
