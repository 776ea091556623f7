"""A law that describes what no effect explains: offered where it closes a gap, and
taken back.
"""

from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import pytest

from cell.gap.subject.strip.subject import patch_file
from cell.gap.subject.subject import Scope
from cell.gap.verdict.accept import accept, undo
from cell.gap.verdict.fit_folder import StoredLaw
from drivers.base.types import Array
from drivers.base.yaml_text import dump_yaml
from drivers.strip.describe import describe, load_strip
from drivers.strip.law import LAW_TERMS, with_law
from tests.support.curves import (
    LAWS,
    Curves,
    Law,
    both,
    bump,
    candidate,
    hidden,
    judged,
    nothing,
)
from tests.support.fit_folders import write_fit
from tests.support.gap_strip_cases import STRIP, denim
from tests.support.refusals import refusal
from tests.support.run_edits import edit_yaml


class Withheld(Curves):
    """Curves whose library lacks the laws `forms`; terms of the same form describe."""

    forms = ("bump",)

    @property
    def scope(self) -> Scope:
        terms = tuple(candidate(form, self.signed) for form in self.forms)
        return replace(super().scope, terms=terms)


def test_a_law_is_offered_for_a_gap_that_no_effect_explains_and_closes_it() -> None:
    found, verdict = judged(Withheld(hidden(bump, 0.2), names=("dead",)))
    assert verdict.verdict == "unexplained"
    assert verdict.effects == []
    assert found.law.terms["bump"] == pytest.approx(0.2, rel=0.05)
    assert found.law.shrink > 0.9
    assert verdict.unexplained.law == found.law.words
    assert verdict.unexplained.stable


def test_a_law_may_have_three_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    ring: Law = lambda t, s, i: 0.2 * np.cos(25.0 * t)  # noqa: E731
    monkeypatch.setitem(LAWS, "ring", ring)  # type: ignore[misc]
    monkeypatch.setattr(Withheld, "forms", ("bump", "wave", "ring"))
    three: Law = lambda t, s, i: both(0.2, -0.2)(t, s, i) + ring(t, s, i)  # noqa: E731
    found, _ = judged(Withheld(three, names=("dead",)))
    assert {*found.law.terms} == {*Withheld.forms}


def test_where_no_law_closes_the_gap_none_is_stated() -> None:
    _, verdict = judged(Curves(hidden(bump, 0.2), names=("dead",)))
    assert verdict.unexplained.law == "no sparse law found"
    assert not verdict.unexplained.stable


def test_no_law_is_offered_where_nothing_is_hidden() -> None:
    for seed in range(4):
        found, _ = judged(Withheld(nothing, names=("dead",), seed=seed))
        assert found.law is None


def test_no_law_is_offered_where_an_effect_is_named() -> None:
    found, verdict = judged(Withheld(hidden(bump, 0.2)))
    assert verdict.verdict == "named"
    assert found.law is None


def wide(t: Array, speed: float, _: int) -> Array:
    return np.asarray(speed * np.exp(-(((t - 0.5) / 0.14) ** 2)))


def test_a_law_stands_beside_a_name_that_only_imitates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(LAWS, "wide", wide)  # type: ignore[misc]
    found, verdict = judged(Withheld(hidden(bump, 0.3), names=("wide", "dead")))
    assert [e.name for e in found.accepted.model.effects] == ["wide"]
    assert verdict.gap.shrink < 0.95
    assert found.law.terms["bump"] == pytest.approx(0.3, rel=0.05)
    assert found.law.shrink > verdict.gap.shrink


def test_no_law_stands_beside_two_effects_that_are_there() -> None:
    found, verdict = judged(Withheld(both(0.2, -0.1)))
    assert sorted(e.name for e in verdict.effects) == ["bump", "wave"]
    assert found.law is None


@pytest.mark.parametrize("name", LAW_TERMS)
def test_a_law_in_the_strip_file_is_what_the_engine_tried(name: str) -> None:
    amount = LAW_TERMS[name].sizes(denim())[0]
    law, plain = {name: amount}, describe(denim(), index=3)
    stated = repr(describe(denim().model_copy(update={"law": law}), index=3))
    assert stated == repr(with_law(plain, law)) != repr(plain)


@pytest.fixture
def fitted(tmp_path: Path) -> tuple[Path, Path]:
    """The folder of a fit that offers a law, and the strip file."""
    file, out = Path(copy(STRIP, tmp_path)), tmp_path / "out"
    law = {"term_speed": {"amount": 0.7}}
    content, _ = patch_file(denim(), {"bending_length": 0.018}, law, "test")
    offered = {"effects": (), "law": StoredLaw(terms={"term_speed": 0.7})}
    write_fit(out, file, "accept_law", {"subject": dump_yaml(content)}, **offered)
    return out, file


def test_an_accepted_law_stands_in_the_file_and_can_be_taken_back(fitted) -> None:
    out, file = fitted
    before = file.read_bytes()
    assert accept(out, file, law=True).effects == ("term_speed",)
    strip = load_strip(file)
    assert strip.law == {"term_speed": 0.7}
    assert describe(strip).mechanics.drag.coefficient == pytest.approx(0.7)
    assert any("no cause" in note.note for note in strip.provenance)
    assert undo(out, file).effects == ("term_speed",)
    assert file.read_bytes() == before


def test_a_law_is_accepted_only_when_asked_for(fitted) -> None:
    out, file = fitted
    with refusal("nothing was named"):
        accept(out, file)


def test_a_law_on_top_of_one_adds_up() -> None:
    strip = denim().model_copy(update={"law": {"term_speed": 0.5}})
    content, _ = patch_file(strip, {}, {"term_speed": {"amount": 0.25}}, "test")
    assert content["law"] == {"term_speed": 0.75}


@pytest.mark.parametrize("law", [{"term_magic": 1.0}, {"term_clock": 5.0}])
def test_a_law_that_no_engine_knows_or_no_strip_has_is_refused(
    law, tmp_path: Path
) -> None:
    file = Path(copy(STRIP, tmp_path))
    edit_yaml(file, law=law)
    with refusal("law"):
        load_strip(file)
