"""What the model predicts of measured folds: white at the truth, and telling away from
it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.gap.subject.strip import simulation, subject
from cell.gap.subject.strip.subject import StripSubject
from tests.support.gap_strip_cases import (
    folds,
    in_noise,
    opened,
    residuals,
    whitened,
    written,
)

NAMES = ("there-and-back", "fast", "early-shake", "taut-lift")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> StripSubject:
    root = tmp_path_factory.mktemp("plain") / "runs"
    written(root, folds(NAMES))
    return opened(root)


def test_nothing_hidden_leaves_noise(plain: StripSubject) -> None:
    found = residuals(plain)
    assert 0.8 < in_noise(plain, found, "profile") < 1.45
    assert 0.8 < in_noise(plain, found, "contact_x") < 1.3
    assert in_noise(plain, found, "layer_touch") < 2.0


@pytest.mark.slow
def test_every_term_shows_and_vanishes_with_its_amount(plain: StripSubject) -> None:
    stated = whitened(plain, residuals(plain))
    for term in plain.scope.terms:
        null = whitened(plain, residuals(plain, {term.name: np.zeros(1)}))
        np.testing.assert_array_equal(null, stated)
        moved = whitened(
            plain, residuals(plain, {term.name: np.array(term.probes[0][0])})
        )
        assert np.abs(moved - stated).max() > 1e-3


def test_a_prediction_does_not_depend_on_company_threads_or_portions(
    plain: StripSubject, monkeypatch: pytest.MonkeyPatch
) -> None:
    stated = [plain.stated(run) for run in plain.runs]
    asked = [
        replace(r, base=r.base * factor) for factor in (1.0, 1.05, 0.97) for r in stated
    ]
    together = plain.simulate(asked)
    plain._simulation._cache.clear()
    alone = [plain.simulate([one])[0] for one in asked]
    plain._simulation._cache.clear()
    monkeypatch.setattr(plain._simulation, "_threads", 2)
    monkeypatch.setattr(subject, "PORTION", 5)
    threaded = plain.simulate(asked[::-1])[::-1]
    for a, b, c in zip(together, alone, threaded, strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.mean, c.mean)


def test_a_strip_that_cannot_lie_as_its_run_begins_leaves_the_others_and_a_defect_is_told(
    plain: StripSubject, monkeypatch: pytest.MonkeyPatch
) -> None:
    slack = {"length_error": np.array([0.06])}  # its layers touch before it rests
    lost, kept = plain.simulate([plain.stated(plain.runs[0], e) for e in (slack, {})])
    assert np.isnan(lost.mean).all()
    assert np.isfinite(kept.mean).all()
    monkeypatch.setattr(simulation, "SHAPE_PERIOD", np.nan)
    with pytest.raises(ValueError, match="NaN"):
        plain.simulate(
            [plain.stated(plain.runs[0], {"length_error": np.array([0.001])})]
        )


def test_wild_points_and_lost_images_do_no_harm(tmp_path: Path) -> None:
    made = folds(["fast", "taut-lift"])
    written(tmp_path / "wild", made, wild=0.08, lost=0.4)
    strip = opened(tmp_path / "wild")
    assert in_noise(strip, residuals(strip), "profile") < 1.5
