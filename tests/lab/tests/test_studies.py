"""Every study keeps the contract; tables, pages and the command say what a journal
holds.
"""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cell.base.campaign.journal import Journal, Record
from cell.gap.selection.screening import DETECTED_SIGMA
from cell.gap.subject.strip.measurement_errors import ModelError
from drivers.base.errors import ConfigurationError
from drivers.base.settings import load
from tests.lab.__main__ import app
from tests.lab.exam.spoilt import TOLD
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
    assert json.loads(json.dumps(cases[0].values, allow_nan=False)) == cases[0].values
    part = StudyRequest(study, 3, 5, Path("out")).parts()[0]
    assert pickle.loads(pickle.dumps(part)) == part  # noqa: S301  of our own
    assert set(study.by) <= set(cases[0].values)
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
    assert sorted(faults) == sorted(2 * [*TOLD])
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


def filled(folder: Path, of: str | None = None, count: int = 4) -> StudyRequest:
    """Some cases of `damping` with made up outcomes, one of them set aside."""
    asked = StudyRequest(study_of("damping"), 0, 6, folder)
    journal, made_of = Journal(asked.journal), of or inputs(asked.study)
    for case in asked.study.cases(0, count):
        facts = {"schema": 1, "key": case.key, "of": made_of}
        outcome = {"values": {"damping": 0.01 * case.number, "length": 0.0}}
        journal.put(Record(**facts, state="measured", outcome=outcome))
    late = asked.study.cases(0, 5)[4]
    facts = {"schema": 1, "key": late.key, "of": made_of}
    journal.put(Record(**facts, state="set_aside", reason="no outcome after 600 s"))
    return asked


def test_a_whole_study_writes_its_data_file_with_its_source(tmp_path: Path) -> None:
    asked = StudyRequest(study_of("damping"), 0, 4, tmp_path)
    for case, damping in zip(
        asked.study.cases(0, 4), (0.03, -0.04, 0.04, -0.03), strict=True
    ):
        facts = {
            "schema": 1,
            "key": case.key,
            "of": inputs(asked.study),
            "state": "measured",
        }
        values = {"damping": damping, "length": 0.0}
        Journal(asked.journal).put(Record(**facts, outcome={"values": values}))
    write_table(read_study(asked))
    found = load(tmp_path / "damping.yaml", ModelError)
    assert found.damping == pytest.approx(0.0354, abs=1e-4)
    assert found.source.startswith("root mean square over blanket, denim; 4 cases")
    assert found.belongs_to == "cell/gap/subject/strip/damping.yaml"


def test_the_command_lists_shows_and_refuses(tmp_path: Path) -> None:
    listed = CliRunner().invoke(app, ["study"])
    assert listed.exit_code == 0
    assert all(name in listed.output for name in studies())
    filled(tmp_path)
    shown = CliRunner().invoke(app, f"study damping --count 6 --out {tmp_path} --show")
    assert shown.exit_code == 0
    assert "4 of 6 so far" in shown.output
    assert "no outcome after 600 s" in (tmp_path / "table.md").read_text()
    out = ["--out", str(tmp_path / "none")]
    for words in (
        *(["--shard", wrong] for wrong in ("0/3", "4/3", "a")),
        ["--show", *out],
    ):
        refused = CliRunner().invoke(app, ["study", "damping", *words])
        assert isinstance(refused.exception, ConfigurationError)
    unknown = CliRunner().invoke(app, "study unkown")
    assert "'unkown' is not known (did you mean 'unknown'?)" in str(unknown.exception)
