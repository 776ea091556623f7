"""Which effects are refitted, and when none is."""

from types import SimpleNamespace
from typing import Any

import pytest

from cell.gap import investigate
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
    monkeypatch.setattr(investigate, "likelihood_scale", lambda _models: scale)
    monkeypatch.setattr(investigate, "ranked_pairs", lambda *_: [])
    monkeypatch.setattr(investigate, "is_exhausted", lambda _fits: True)
    monkeypatch.setattr(investigate.search, "fit_scores", fit_scores)
    monkeypatch.setattr(investigate.search, "other_signs", lambda *_: [])
    monkeypatch.setattr(Fits, "of_size", lambda *_: [])
    subject: Any = SimpleNamespace(scope=SimpleNamespace(candidates=()))
    base = SimpleNamespace(estimate=None, model=SimpleNamespace(name="", names=frozenset()))
    fitted: Any = SimpleNamespace(base=base, doubted=gap)
    screened: Any = SimpleNamespace(known=None, singles=(Score(("seam",), gain, {}),))
    fits = Fits((base,))  # type: ignore[arg-type]
    investigate._refit_singles(
        subject, fitted, fits, screened, lambda _asked: [], lambda _stage, _share: None
    )
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
    probable = SimpleNamespace(model=SimpleNamespace(effects=("hem",)))
    most_probable: Any = SimpleNamespace(models=[SimpleNamespace(names={"hem"})])
    monkeypatch.setattr(investigate, "choose", lambda _fits: SimpleNamespace(accepted=accepted))
    monkeypatch.setattr(investigate, "is_exhausted", lambda _fits: False)
    monkeypatch.setattr(investigate, "_leaves_more", lambda _fits, **_: False)
    monkeypatch.setattr(investigate.search, "shape_parameters", lambda *_: [])
    monkeypatch.setattr(investigate.search, "shortlist", shortlist)
    monkeypatch.setattr(investigate.search, "extend_where_shown", extend)
    monkeypatch.setattr(investigate, "_posterior", lambda *_: most_probable)
    monkeypatch.setattr(investigate.search, "fit_scores", lambda _simulate, fits, *_: fits)
    fits: Any = SimpleNamespace(
        models=(None, None),
        base=SimpleNamespace(estimate=None),
        of=lambda names: {"seam": True, "hem": probable}.get(*names),
        merge=lambda _more: fits,
    )
    singles = tuple(Score((name,), 1.0, {}) for name in ("seam", "crease"))
    fitted: Any = SimpleNamespace(doubted=gap)
    screened: Any = SimpleNamespace(singles=singles, probed=())
    subject: Any = SimpleNamespace(scope=SimpleNamespace(candidates=()))
    investigate._refit_further(
        subject, fitted, fits, screened, lambda _asked: [], lambda _stage, _share: None
    )
    assert asked == (["beside seam", "beside hem"] if named else ["crease"] if gap else [])
