"""The benchmark as a whole: what it is asked, what survives a kill, what it tells."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from typer.testing import CliRunner

from cell.benchmark import run
from cell.benchmark.page import page_of
from cell.benchmark.results import (
    BenchmarkSpec,
    ImageFold,
    RangeFolds,
    Results,
)
from cell.benchmark.summary import StripNumbers, claims
from cell.cli.app import app
from cell.config.places import find_configs
from drivers.errors import ConfigurationError
from tests.support.campaign_parts import Fine

pytestmark = pytest.mark.slow

CONFIGS = find_configs(Path(__file__).parents[3] / "configs")
TITLES = ("Displacement of the strips", "Repeatability", "Force that", "maps")
POLICIES = ("triangular", "circular", "shifted", "planned", "feedback")
STRIPS = ("blanket", "denim", "rib-knit")
USUAL = {"triangular": -0.040, "circular": 0.060, "shifted": 0.005, "planned": -0.001}
USUAL |= {"feedback": 0.004}


def asked(*policies: str, strips: tuple[str, ...] = (), quick: bool = True) -> BenchmarkSpec:
    return BenchmarkSpec.build(CONFIGS, policies, strips, None, 0, quick=quick)


def image_fold(policy: str, strip: str, d: float | None, seed: int = 0) -> ImageFold:
    return ImageFold(
        strip=strip,
        bending_length=0.01 + 0.002 * STRIPS.index(strip),
        retardation_time=0.05,
        policy=policy,
        seed=seed,
        outcome="path_done" if d is None else "layer_touch",
        reason="",
        displacement=d,
        displacement_true=d,
        duration=14.0,
        wall=7.0,
        run="nowhere",
    )


def measured(**changed: float | None) -> Results:
    """A whole benchmark; `changed` are displacements by feedback on single strips."""
    rng = np.random.default_rng(0)
    folds = [
        image_fold(p, s, changed.get(s, USUAL[p]) if p == "feedback" else USUAL[p])
        for p in POLICIES
        for s in STRIPS
    ]
    folds += [image_fold(p, "denim", USUAL[p] + 2e-4, seed=1) for p in POLICIES]
    over = [
        RangeFolds(
            policy=p,
            engine=engine,
            side=4,
            displacement=(None, *(USUAL[p] + 0.004 * rng.normal(size=15)).tolist()),
            force=tuple(rng.uniform(0.1, 0.4, size=16).tolist()),
        )
        for p in POLICIES
        for engine in ("rod", "chain")
    ]
    return Results(
        schema=1,
        asked=asked(*POLICIES),
        made_with={"cell": "twin-cell"},
        speed=0.1,
        results=(*folds, *over),
    )


def test_unknown_names_are_refused_with_those_that_exist() -> None:
    with pytest.raises(ConfigurationError, match=r"--policies: unknown name 'squar'.*triangular"):
        asked("squar")
    with pytest.raises(ConfigurationError, match=r"--strips: unknown name 'felt'.*denim"):
        asked(strips=("felt",))


def test_benchmark_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = tmp_path / "marks"
    parts = (Fine("one", marks), Fine("three", marks))
    monkeypatch.setattr(run, "order", lambda *_: parts)
    monkeypatch.setattr(run, "calibration_of", lambda _: None)
    arguments = ["benchmark", "--quick", "--out", str(tmp_path), "--json", "--picture"]
    arguments += [str(tmp_path / "main.png"), "--configs", str(CONFIGS.folder)]
    first = CliRunner().invoke(app, arguments)
    assert first.exit_code == 0, first.output
    assert sorted(marks.read_text().split()) == ["one", "three"]
    parts = (*parts, Fine("later", marks))
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert sorted(marks.read_text().split()) == ["later", "one", "three"]
    kept = json.loads((tmp_path / "benchmark.json").read_text())
    assert [r["displacement"] for r in kept["results"]] == [[0.03], [0.05], [0.05]]
    assert Results.model_validate(kept).asked == asked()


def test_claims_are_those_of_the_text_and_can_fail() -> None:
    assert [claim.held for claim in claims(measured())] == [True] * 6
    worse = claims(measured(blanket=0.2, denim=0.2))
    assert [claim.held for claim in worse] == [False, True, True, False, True, False]
    fold = image_fold("feedback", "denim", 0.002).model_copy(update={"displacement_true": 0.0})
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
