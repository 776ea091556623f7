"""What is named where laws have thresholds, places and shapes, and where runs went
another way.
"""

from dataclasses import replace

import numpy as np
import pytest

from cell.gap.selection.likelihood import MIN_GAIN
from cell.gap.subject.subject import Candidate, Scope
from cell.gap.verdict.confidence import LEAST
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter
from tests.support import curves
from tests.support.curves import (
    Curves,
    Law,
    T,
    Touched,
    bump,
    hidden,
    judged,
    wave,
)

THRESHOLD, PROBES, CREEP = 0.5, (0.3, 1.0, 3.0), 0.02


class Slipping(Curves):
    """Curves with a bump as high as an effect is beyond its threshold."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        size = Parameter("size", "m", 0.0, 0.0, 5.0, 1e-3, 1.0)
        slip = Candidate(
            "slip", "it slips", "strip", (size,), tuple(((p,),) for p in PROBES)
        )
        return Scope(whole.base, (slip,), whole.quantities)

    def added(self, name: str, values: Array, speed: float) -> Array:
        return slipped(values[0]) * bump(T, speed, 0)


def slipped(size: float) -> float:
    """Hardly anything up to the threshold: ends creep before they slip."""
    return CREEP * size + max(0.0, size - THRESHOLD)


PLACES = (0.15, 0.35, 0.55, 0.75)


def lump(t: Array, place: float) -> Array:
    return np.exp(-(((t - place) / 0.08) ** 2))


class Lumps(Curves):
    """Curves that may have a lump, up or down, at a place."""

    @property
    def scope(self) -> Scope:
        whole = super().scope
        parameters = (
            Parameter("size", "m", 0.0, -5.0, 5.0, 1e-3, 1.0),
            Parameter("place", "m", 0.5, 0.0, 1.0, 1e-3, 1.0, role="place"),
        )
        probes = tuple(((0.1, place),) for place in PLACES)
        found = Candidate("lump", "there is a lump", "strip", parameters, probes)
        return Scope(whole.base, (found, *whole.candidates), whole.quantities)

    def added(self, name: str, values: Array, speed: float) -> Array:
        if name != "lump":
            return super().added(name, values, speed)
        size, place = values
        return size * lump(T, place)


def two_sided(waves: float) -> Lumps:
    """Down at 0.56, and less up at 0.34: a lump up is a local optimum, beside `waves`
    too.
    """

    def truth(t: Array, speed: float, index: int) -> Array:
        return (
            -0.3 * lump(t, 0.56) + 0.2 * lump(t, 0.34) + waves * wave(t, speed, index)
        )

    return Lumps(truth, names=("wave",))


class Bending(Curves):
    """Curves whose bump may lean: its finer parameter adds a share of its slope.

    Less lean than `own_from` is not its own.
    """

    own_from = -np.inf

    @property
    def scope(self) -> Scope:
        whole = super().scope
        lean = Parameter(
            "lean", "1", 0.0, 0.0, 5.0, 1e-3, 1.0, role="shape", own_from=self.own_from
        )
        first, *others = whole.candidates
        return replace(
            whole, candidates=(replace(first, shape_parameters=(lean,)), *others)
        )

    def added(self, name: str, values: Array, speed: float) -> Array:
        plain = super().added(name, values, speed)
        if len(values) < 2:
            return plain
        size, lean = values
        return plain + size * lean * leaning(T, speed, 0)


def leaning(t: np.ndarray, speed: float, _: int) -> np.ndarray:
    return 5.0 * (t - 0.5) * bump(t, speed, 0)


def astray(*runs: int) -> Law:
    """A hidden bump, and runs that besides went another way."""
    law = hidden(bump, 0.3)
    return lambda t, s, i: law(t, s, i) + 0.5 * np.cos(25.0 * t) * (i in runs)


@pytest.fixture
def single(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every run is of a condition of its own."""
    more = {f"v{i}": 0.6 + 0.3 * i for i in range(7)}
    monkeypatch.setattr(curves, "SPEEDS", {**curves.SPEEDS, **more})


@pytest.mark.usefixtures("single")
def test_one_run_that_went_another_way_is_told_and_does_not_hide_what_the_others_show():
    _, verdict = judged(Curves(astray(4), repeats=1))
    assert [e.name for e in verdict.effects] == ["bump"]
    assert "run r4 differs from all others" in verdict.unexplained.description


@pytest.mark.usefixtures("single")
def test_a_probable_name_says_what_it_does_not_predict_and_no_loss_vetoes_it() -> None:
    findings, verdict = judged(Curves(astray(4, 5), repeats=1))
    assert findings.decision.evidence.loss > MIN_GAIN
    assert [e.name for e in verdict.effects] == ["bump"]
    assert "it does not account for all" in str(verdict)


@pytest.mark.parametrize(("off", "kind"), [(0.0, "named"), (0.3, "unexplained")])
def test_a_touch_that_is_off_in_all_runs_is_not_lost_among_points(
    off: float, kind: str
) -> None:
    law = hidden(bump, 0.3)
    _, verdict = judged(Touched(lambda t, s, i: law(t, s, i) + off * (t == 1.0)))
    assert verdict.verdict == kind


@pytest.mark.usefixtures("single")
@pytest.mark.parametrize("shape", [bump, wave, lambda t, s, i: np.cos(25.0 * t)])
def test_a_mishap_in_one_run_is_no_effect(shape: Law) -> None:
    _, verdict = judged(
        Curves(lambda t, s, i: 0.3 * shape(t, s, i) * (i == 4), repeats=1)
    )
    assert verdict.verdict == "unexplained"


@pytest.mark.parametrize("size", [0.55, 0.9, 2.0])
def test_what_slips_a_little_beyond_its_threshold_is_found(size: float) -> None:
    _, verdict = judged(Slipping(lambda t, s, i: slipped(size) * bump(t, s, i)))
    (effect,) = verdict.effects
    assert effect.parameters["size"].value == pytest.approx(size, abs=0.02)


@pytest.mark.parametrize(
    ("waves", "name", "prefix"), [(0.0, "lump", ""), (0.1, "lump + wave", "lump.")]
)
def test_a_local_optimum_of_one_sign_is_left_for_the_other(
    waves: float, name: str, prefix: str
) -> None:
    _, verdict = judged(two_sided(waves))
    (lump,) = (c for c in verdict.candidates if c.name == name)
    assert lump.parameters[f"{prefix}size"].value < -0.2
    assert lump.parameters[f"{prefix}place"].value == pytest.approx(0.56, abs=0.02)


@pytest.mark.parametrize("lean", [0.0, 0.5])
def test_a_law_is_bent_where_it_only_resembles_the_librarys(lean: float) -> None:
    subject = Bending(
        lambda t, s, i: 0.2 * bump(t, s, i) + 0.2 * lean * leaning(t, s, i)
    )
    (effect,) = judged(subject)[1].effects
    found = [effect.parameters[key].value for key in effect.parameters]
    assert found == pytest.approx([0.2, lean][: 2 if lean else 1], abs=0.02)


def test_a_shape_that_shows_only_beside_a_stronger_effect_is_found() -> None:
    def both(t: Array, s: float, i: int) -> Array:
        return 2.0 * wave(t, s, i) + 0.1 * bump(t, s, i) + 0.2 * leaning(t, s, i)

    effects = {e.name: e.parameters for e in judged(Bending(both))[1].effects}
    assert effects["wave"]["size"].value == pytest.approx(2.0, abs=0.02)
    assert effects["bump"]["lean"].value == pytest.approx(2.0, abs=0.3)


def test_an_effect_by_a_shape_that_is_not_its_own_stands_in_for_another() -> None:
    subject = Bending(lambda t, s, i: 0.2 * bump(t, s, i) + 0.2 * leaning(t, s, i))
    subject.own_from = 2.0
    _, verdict = judged(subject)
    assert verdict.verdict == "unexplained"
    assert "bump has a shape by which it stands in" in verdict.unexplained.description
    assert not verdict.suspected


def test_nothing_is_named_with_an_amount_at_the_end_of_what_is_tried() -> None:
    findings, verdict = judged(Curves(hidden(bump, 5.005)))
    assert findings.decision.at_ends == {"bump": ["size"]}
    assert findings.decision.probabilities["bump"] > LEAST
    assert verdict.verdict == "unexplained"
    assert "bump lies at the end of the range that is tried: size" in str(verdict)
    assert [step.kind for step in verdict.steps] != ["accept_suspected"]
