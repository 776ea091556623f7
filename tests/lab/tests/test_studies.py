"""Every study keeps the contract; tables, pages and the command say what a journal
holds.
"""

import json
import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cell.base.campaign.journal import Journal, Record
from cell.gap.selection.screening import DETECTED_SIGMA
from cell.gap.verdict.confidence import LogOddsCalibration
from drivers.base.errors import ConfigurationError
from drivers.base.settings import load
from tests.lab.__main__ import app
from tests.lab.exam.spoilt import FAULTS
from tests.lab.studies.campaign import StudyRequest, inputs, read_study
from tests.lab.studies.catalogue import mechanisms, studies, study_of
from tests.lab.studies.study import Quantity, Statistic, figure
from tests.lab.studies.table import write_table


@pytest.fixture
def unseen_at_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mechanism's effect shows as it is drawn again, which nothing simulates here."""
    monkeypatch.setattr(
        mechanisms, "power", lambda case: DETECTED_SIGMA * (case["drawn"] > 1)
    )


@pytest.mark.usefixtures("unseen_at_first")
@pytest.mark.parametrize("name", sorted(studies()))
def test_a_study_is_drawn_from_its_seed_and_travels(name: str) -> None:
    study = study_of(name)
    cases = study.cases(3, min(study.usual, 30))
    assert study.cases(3, 2) == cases[:2]
    assert len({case.key for case in cases}) == len(cases)
    values = cases[0].values
    assert json.loads(json.dumps(values, allow_nan=False)) == values
    part = StudyRequest(study, 3, 5, Path("out")).parts()[0]
    assert pickle.loads(pickle.dumps(part)) == part  # noqa: S301  of our own
    assert set(study.by) <= set(values)
    assert study.question.endswith("?")
    assert study.name.replace("-", "_") == study.measure.__module__.rsplit(".", 1)[1]
    assert study.quick <= study.usual


@pytest.mark.usefixtures("unseen_at_first")
def test_mechanisms_are_drawn_until_one_effect_shows_and_a_fifth_is_spoilt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sound = [case.values for case in mechanisms.STUDY.cases(3, 70)]
    assert {v["drawn"] for v in sound if v["kind"] == "one effect"} == {2}
    assert {v["drawn"] for v in sound if v["kind"] != "one effect"} == {1}
    assert not any(v["spoilt"] for v in sound)
    monkeypatch.setenv(mechanisms.SPOILT, "yes")
    every = [case.values for case in mechanisms.STUDY.cases(3, 70)]
    faults = [v["spoilt"] for v in every if v["kind"] == "spoilt"]
    assert sorted(faults) == sorted(2 * [*FAULTS])
    assert {v["kind"] for v in every} == {*mechanisms.KINDS, "spoilt"}


@pytest.mark.slow
def test_an_interval_contains_the_truth_at_its_nominal_rate() -> None:
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(200):
        values = rng.normal(1e-3, 1e-3, size=40)
        found = figure(Quantity("d", Statistic.MEAN), [[v] for v in values])
        inside += found.low <= 1.0 <= found.high
    assert 180 <= inside <= 199


def filled(asked: StudyRequest, outcomes: Sequence[Mapping[str, Any]]) -> None:
    """Store made up outcomes of the first cases, and that the next one is set aside."""
    journal, of = Journal(asked.journal), inputs(asked.study.measure)
    late, *cases = reversed(asked.study.cases(0, len(outcomes) + 1))
    for case, values in zip(reversed(cases), outcomes, strict=True):
        facts = {"schema": 1, "key": case.key, "of": of, "state": "measured"}
        journal.put(Record(**facts, outcome={"values": values}))
    facts = {"schema": 1, "key": late.key, "of": of, "state": "set_aside"}
    journal.put(Record(**facts, reason="no outcome after 600 s"))


def test_a_whole_study_writes_its_data_file_with_its_source(tmp_path: Path) -> None:
    asked = StudyRequest(study_of("confidence"), 0, 4, tmp_path)
    signs = {"log_odds": 9.0, "gain": 100.0, "left": 0.6, "correlation": 0.0}
    claim = {"signs": signs, "right": True, "outside": False, "hides": True}
    filled(asked, [{"claim": {**claim, "case": str(i)}} for i in range(4)])
    write_table(read_study(asked))
    found = load(tmp_path / "confidence.yaml", LogOddsCalibration)
    assert found.source.startswith("4 verdicts that accept, 0 of them wrong")
    assert "4 cases; 95 % intervals over cases" in found.source
    assert found.belongs_to == "cell/gap/verdict/confidence.yaml"


def test_the_command_lists_shows_and_refuses(tmp_path: Path) -> None:
    invoke = CliRunner().invoke
    listed = invoke(app, ["study"])
    assert listed.exit_code == 0
    assert all(name in listed.output for name in studies())
    filled(StudyRequest(study_of("looks"), 0, 6, tmp_path), 4 * [{"error": 0.001}])
    shown = invoke(app, f"study looks --count 6 --out {tmp_path} --show")
    assert shown.exit_code == 0
    assert "4 of 6 so far" in shown.output
    assert "no outcome after 600 s" in (tmp_path / "table.md").read_text()
    out = ["--out", str(tmp_path / "none")]
    for words in (
        *(["--shard", wrong] for wrong in ("0/3", "4/3", "a")),
        ["--show", *out],
    ):
        refused = invoke(app, ["study", "looks", *words])
        assert isinstance(refused.exception, ConfigurationError)
    unknown = invoke(app, "study unkown")
    assert "'unkown' is not known (did you mean 'unknown'?)" in str(unknown.exception)
