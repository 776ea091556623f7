"""The benchmark as a whole: what it is asked, what survives a kill, what it tells."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from cell.studies.page import page_of
from cell.studies.results import Results
from cell.studies.summary import StripNumbers, claims
from tests.support.campaign_parts import Fine
from tests.support.commands import invoke
from tests.support.made_results import CONFIGS, asked, image_fold, measured
from tests.support.refusals import refusal

pytestmark = pytest.mark.slow

TITLES = ("Displacement of the strips", "Repeatability", "Force that", "maps")


def test_unknown_names_are_refused_with_those_that_exist() -> None:
    with refusal(r"--policies: unknown name 'squar'.*triangular"):
        asked("squar")
    with refusal(r"--strips: unknown name 'felt'.*denim"):
        asked(strips=("felt",))


def test_benchmark_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = tmp_path / "marks"
    fine = (Fine("one", marks), Fine("three", marks))
    monkeypatch.setattr("cell.studies.parts.parts_of", lambda *_: fine)
    monkeypatch.setattr("cell.studies.parts.calibration_of", lambda _: None)
    words = f"benchmark --quick --out {tmp_path} --json --picture {tmp_path}/main.png"
    words += f" --configs {CONFIGS.folder}"
    first = invoke(words)
    assert first.exit_code == 0, first.output
    assert sorted(marks.read_text().split()) == ["one", "three"]
    fine = (*fine, Fine("later", marks))
    assert invoke(words).exit_code == 0
    assert sorted(marks.read_text().split()) == ["later", "one", "three"]
    kept = json.loads((tmp_path / "benchmark.json").read_text())
    assert [r["displacement"] for r in kept["results"]] == [[0.03], [0.05], [0.05]]
    assert Results.model_validate(kept).asked == asked()


def test_claims_are_those_of_the_text_and_can_fail() -> None:
    assert [claim.held for claim in claims(measured())] == [True] * 6
    worse = claims(measured(blanket=0.2, denim=0.2))
    assert [claim.held for claim in worse] == [False, True, True, False, True, False]
    fold = image_fold("feedback", "denim", 0.002).model_copy(
        update={"displacement_true": 0.0}
    )
    assert StripNumbers.of_folds((fold,), 1).misread == 0.002


def test_page_needs_nothing_else_and_says_what_is_not_the_papers() -> None:
    page = page_of(measured())
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert "Of the paper, the numbers that its text states are drawn." in page
    for title in TITLES:
        assert title in page
    figures = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(figures) == 5
    for figure in figures:
        Xml.fromstring(figure)  # noqa: S314
    for number in ("36.8", "+62.7", "&lt; 20", "within 1 mm"):
        assert any(number in figure for figure in figures)
