"""The report shows what the policy predicted, and whether the strip behaved like the model."""

import json
import re
from dataclasses import asdict
from html import unescape

import numpy as np
import pytest

from cell.record.events import COLUMN_NAMES, Outlook, row_of
from cell.record.files import EVENTS
from cell.record.run import Event, read_run
from cell.report.figures import outlook_figure, predictions
from cell.report.page import write_report
from policies.prediction import Estimate, FoldPrediction

PREDICTED = asdict(
    FoldPrediction(
        displacement=0.0004,
        sigma=0.0009,
        bending_length=Estimate(0.0167, 0.0165, 0.0169),
        retardation_time=Estimate(0.027, 0.022, 0.034),
        yield_curvature=Estimate(1.4, 0.4, 2.6),
        blind=False,
    )
)
UNLIKE = {
    "like_model": False,
    "residual": 0.0031,
    "yield_curvature": 2.0,
    "reason": "this strip does not behave like the model: find out with `cell gap plan`",
}


@pytest.fixture
def predicting(make_run, tmp_path):
    folder = make_run(tmp_path, foretold=PREDICTED, agreement=UNLIKE)
    with (folder / EVENTS).open("a") as events:
        for k in range(60):
            line = {"t": 2.0 + 0.05 * k, "kind": "foretold", **PREDICTED}
            events.write(json.dumps(line) + "\n")
    return folder


def test_page_states_and_draws_what_was_predicted(predicting) -> None:
    page = write_report(predicting).read_text()
    text = re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page)))
    for claim in ("+0.4 mm ± 0.9 mm", "16.7 mm (16.5 to 16.9)", "27 ms (22 to 34)"):
        assert claim in text, claim
    assert "This strip does not behave like the model" in text
    assert "do not agree, 3.1 mm apart" in text
    assert "predicted 60 times" in text
    assert "foretold" not in text
    assert page.count("<svg") == 4


def test_page_of_a_policy_that_predicts_nothing_has_no_such_part(finished) -> None:
    run = read_run(finished)
    assert predictions(run.result) == []
    assert len(Outlook.of(run.events()).t) == 0


def test_rows_hold_the_interval_of_each_value() -> None:
    outlook = Outlook.of([Event(3.0, "foretold", PREDICTED), Event(2.0, "foretold", PREDICTED)])
    assert outlook.t.tolist() == [2.0, 3.0]
    assert outlook.column("displacement_high") == pytest.approx([0.0013, 0.0013])
    assert outlook.column("retardation_time_low") == pytest.approx([0.022, 0.022])


@pytest.mark.parametrize(
    "spoilt", [{}, {"displacement": "far", "sigma": True, "bending_length": 3.0}]
)
def test_spoilt_prediction_is_drawn_as_nothing(finished, spoilt) -> None:
    assert not np.isfinite(row_of(spoilt)).any()
    assert len(row_of(spoilt)) == len(COLUMN_NAMES)
    outlook = Outlook.of([Event(float(t), "foretold", spoilt) for t in range(3)])
    assert "<svg" in outlook_figure(read_run(finished), outlook)
