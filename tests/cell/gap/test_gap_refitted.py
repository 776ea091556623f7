"""Which effects are refitted, and when none is."""

from types import SimpleNamespace
from typing import Any

import pytest

from cell.gap import forward_selection
from cell.gap.forward_selection import ForwardSelection
from cell.gap.selection.fits import Fits
from cell.gap.selection.score import Score

LEAST = 5.0  # nats


def refitted(monkeypatch: pytest.MonkeyPatch, *, gain: float, gap: bool) -> list[str]:
    """The effects that are refitted where the screen expects `gain` of one and little of pairs."""
    asked: list[str] = []

    def fit_scores(_simulate: Any, fits: Fits, scores: list[Score], _known: Any) -> Fits:
        asked.extend(s.names[0] for s in scores)
        return fits

    scale = SimpleNamespace(least=LEAST, inefficiency=1.0)
    monkeypatch.setattr(forward_selection, "likelihood_scale", lambda _models: scale)
    monkeypatch.setattr(forward_selection, "ranked_pairs", lambda *_: [])
    monkeypatch.setattr(forward_selection, "is_exhausted", lambda *_: True)
    monkeypatch.setattr(forward_selection.search, "fit_scores", fit_scores)
    monkeypatch.setattr(forward_selection.search, "other_signs", lambda *_: [])
    monkeypatch.setattr(Fits, "of_size", lambda *_: [])
    subject: Any = SimpleNamespace(scope=SimpleNamespace(candidates=()))
    base = SimpleNamespace(estimate=None, model=SimpleNamespace(name="", names=frozenset()))
    fitted: Any = SimpleNamespace(base=base, doubted=gap)
    screened: Any = SimpleNamespace(known=None, singles=(Score(("seam",), gain, {}),))
    fits = Fits((base,))  # type: ignore[arg-type]
    ForwardSelection(
        subject, lambda _asked: [], lambda _stage, _share: None, fitted, screened
    ).refit_singles(fits)
    return asked


def test_where_the_base_leaves_a_gap_effects_of_which_the_screen_expects_little_are_refitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert refitted(monkeypatch, gain=0.5 * LEAST, gap=True) == ["seam"]
    assert refitted(monkeypatch, gain=2.0 * LEAST, gap=False) == ["seam"]


def test_where_it_leaves_none_they_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    assert refitted(monkeypatch, gain=0.5 * LEAST, gap=False) == []


@pytest.mark.parametrize(("gap", "named"), [(True, False), (False, False), (True, True)])
def test_where_all_residuals_show_no_gap_a_gap_is_named_or_its_name_gets_a_second(
    monkeypatch: pytest.MonkeyPatch, *, gap: bool, named: bool
) -> None:
    asked: list[str] = []

    def shortlist(_simulate: Any, _base: Any, scores: list[Score], *_: Any) -> list[Score]:
        asked.extend(s.names[0] for s in scores)
        return []

    def extend(_simulate: Any, fits: Fits, models: list[Any], *_: Any) -> Fits:
        asked.extend(f"beside {m.model.effects[0]}" for m in models)
        return fits

    effects = ("seam",) if named else ()
    accepted = SimpleNamespace(model=SimpleNamespace(effects=effects))
    predicts_best = SimpleNamespace(model=SimpleNamespace(effects=("hem",)))
    monkeypatch.setattr(ForwardSelection, "_accept", lambda *_: accepted)
    monkeypatch.setattr(forward_selection, "is_exhausted", lambda *_: False)
    monkeypatch.setattr(forward_selection, "_leaves_more", lambda _fits, **_: False)
    monkeypatch.setattr(forward_selection.search, "shape_parameters", lambda *_: [])
    monkeypatch.setattr(forward_selection.search, "shortlist", shortlist)
    monkeypatch.setattr(forward_selection.search, "extend_where_shown", extend)
    monkeypatch.setattr(forward_selection.search, "fit_scores", lambda _simulate, fits, *_: fits)
    fits: Any = SimpleNamespace(
        models=(None, None),
        base=SimpleNamespace(estimate=None),
        best=predicts_best,
        of=lambda names: {"seam": True}.get(*names),
        merge=lambda _more: fits,
    )
    singles = tuple(Score((name,), 1.0, {}) for name in ("seam", "crease"))
    fitted: Any = SimpleNamespace(doubted=gap)
    screened: Any = SimpleNamespace(singles=singles, probed=())
    subject: Any = SimpleNamespace(scope=SimpleNamespace(candidates=()))
    ForwardSelection(
        subject, lambda _asked: [], lambda _stage, _share: None, fitted, screened
    ).refit_further(fits)
    assert asked == (["beside seam", "beside hem"] if named else ["crease"] if gap else [])
