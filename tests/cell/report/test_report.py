"""The page of a run: verdict, figures, facts, predictions; and the page of a
calibration.
"""

import base64
import json
import re
import shutil
from dataclasses import asdict, replace
from html import unescape
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from calibration.calibration import save_calibration
from cell.record.files import EVENTS
from cell.record.listing import read_row
from cell.record.run import read_run
from cell.record.writer import RunWriter
from cell.report.calibration_page import write_calibration_report
from cell.report.page import advice, report, write_report
from cell.report.page_verdict import verdict_of
from cell.report.runs_page import write_comparison, write_runs_page
from drivers.base.types import Frame
from policies.policy import FoldPrediction, ParameterEstimate
from tests.cell.conftest import HEADER
from tests.support.commands import invoke
from tests.support.plain_cell import ARM
from tests.support.run_edits import edit_yaml

VOID = {"meta", "img", "br", "hr", "link", "input"}
PREDICTED = asdict(
    FoldPrediction(
        displacement=0.0004,
        sigma=0.0009,
        bending_length=ParameterEstimate(0.0167, 0.0165, 0.0169),
        retardation_time=ParameterEstimate(0.027, 0.022, 0.034),
        yield_curvature=ParameterEstimate(1.4, 0.4, 2.6),
        blind=False,
    )
)
UNLIKE = {
    "like_model": False,
    "residual": 0.0031,
    "yield_curvature": 2.0,
    "reason": (
        "this strip does not behave like the model: find out with `cell gap plan`"
    ),
}


class Outline(HTMLParser):
    """Checks that elements close in order and remembers what a page leans on."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.crossed: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.addresses += [
            value for name, value in attrs if name in {"src", "href"} and value
        ]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if self.open.pop() != tag:
            self.crossed.append(tag)

    def handle_startendtag(self, tag, attrs):
        """It opens nothing."""


@pytest.fixture(scope="module")
def page(finished):
    return write_report(finished).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def dead_page(killed):
    return write_report(killed).read_text(encoding="utf-8")


BESIDE = ("frames/", "calibration.yaml", "ticks.parquet", "profile.parquet", "run.yaml")


def outline(text: str) -> Outline:
    parsed = Outline()
    parsed.feed(text)
    return parsed


def words(text: str) -> str:
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", text)).split())


def test_page_is_well_formed_and_needs_nothing_else(page, dead_page):
    for text in (page, dead_page):
        parsed = outline(text)
        assert parsed.open == []
        assert parsed.crossed == []
        assert all(a.startswith(("data:", "#", *BESIDE)) for a in parsed.addresses)
        assert "@import" not in text
        assert "url(http" not in text


def test_film_of_a_run_plays_in_step_with_its_curves(tmp_path):
    writer = RunWriter(tmp_path, HEADER, "none", patient=True, film="libx264")
    for k in range(12):
        stamp = 0.03 * k - 0.07
        image = np.full((64, 96, 3), 9 * k, np.uint8)
        writer.frame(Frame(stamp, stamp + 0.02, "made", k, image))
        writer.tick(replace(ARM, stamp=0.01 * k), "FOLD")
    writer.finish({"outcome": "path_done"})
    text = write_report(writer.folder).read_text()
    assert outline(text).crossed == []
    for claim in (
        'data-begin="-0.070000" src="data:video/mp4;base64,',
        'min="0.070"',  # from the lift on, not from the picture before it
        '<i style="left: 0.00%" title="fold, 0.00 s">',
    ):
        assert claim in text, claim
    limits = re.findall(r"x&quot;:{&quot;limits&quot;:\[(\S+?),(\S+?)\]", text)
    first, last = map(float, limits[-1])
    assert first <= 0.0
    assert last >= 0.11
    assert text.index("<video") < text.index("<h1>")
    assert len(text) < 3_000_000
    (writer.folder / "film.mp4").unlink()
    assert "<video" not in write_report(writer.folder).read_text()


def test_verdict_stands_on_top_with_sign_error_and_truth(page):
    top = words(page[page.index("<main") : page.index("In numbers")])
    for claim in (
        "Folded: the edges lie 31.0 mm apart",
        "Normal or not is unknown: nothing was predicted, 0 earlier folds of denim",
        "edges, once laid down −31.0 mm short, ± 1.0 mm",
        "first touch −36.3 mm short, ± 1.0 mm; true on the twin −35.1 mm",
        "Next: cell gap plan --strip denim finds why it lies beyond the 20 mm",
    ):
        assert claim in top, claim


def test_page_shows_pictures_figures_events_and_facts(page):
    assert page.count("data:image/jpeg") == 5  # two are on top, large
    assert page.count("<svg") == 2  # figures; no fold before it to draw
    text = words(page)
    for claim in (
        "FOLD, after made",
        "contact 450 mm",
        "seed 7",
        "drivers.arm twin",
        "l1",
    ):
        assert claim in text, claim


def test_numbers_of_weight_stand_among_the_folds_of_the_strip_before(
    make_run, tmp_path, monkeypatch
):
    monkeypatch.setattr("cell.report.page_verdict.LEAST_FOLDS", 1)
    first = make_run(tmp_path)
    later = first.rename(tmp_path / "20200101T000000Z-denim-fold-0001")
    again = make_run(tmp_path)
    said = "Normal for a fold of denim by triangular: 1 fold before: −31.0&nbsp;mm."
    assert said in write_report(again).read_text()
    edit_yaml(later / "run.yaml", policy="planned")
    assert "0 earlier folds of denim by triangular" in write_report(again).read_text()


def test_dead_run_is_explained(dead_page):
    text, ended = words(dead_page), "the twin's arm ended with its process"
    for claim in (
        "The process died at t = 4.28 s in state FOLD",
        "There is no result.",
        ended,
    ):
        assert claim in text
    # counted from the preflight, known of an ended run only
    assert "<dt>duration" not in dead_page
    assert dead_page.count("<svg") == 2


def test_after_death_at_a_real_arm_the_hand_is_opened_first(killed, tmp_path):
    folder = shutil.copytree(killed, tmp_path / killed.name)
    edit_yaml(folder / "run.yaml", drivers={"arm": "fci"})
    steps = advice(read_run(folder))
    assert "cell open" in steps[1]
    assert "Lay the strip flat again." in steps


def test_run_under_way_is_not_called_dead(tmp_path):
    writer = RunWriter(tmp_path, HEADER, "none")
    assert "Still under way" in words(report(read_run(writer.folder)))
    writer.close()


def test_fault_is_named_with_its_reason(finished):
    run = read_run(finished)
    fault = type(run.result).model_validate(
        {"outcome": "stale_image", "reason": "the newest image is 0.31 s old"}
    )
    said = verdict_of(replace(run, result=fault))
    assert said.tone == "bad"
    assert said.headline == "Stopped by a fault: stale image"
    assert said.sentences[0] == "The newest image is 0.31 s old."


def test_report_can_be_written_again_with_the_same_bytes(make_run, tmp_path):
    folder = make_run(tmp_path)
    before = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    first = write_report(folder).read_bytes()
    assert write_report(folder).read_bytes() == first
    after = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    assert {**before, "report.html": first} == after


def test_report_of_a_laboratorys_run_needs_only_the_four_files(make_run, tmp_path):
    folder = make_run(tmp_path)
    beside = (
        "events.jsonl sights.parquet truth.yaml calibration.yaml frames/index.jsonl"
    )
    for name in beside.split():
        (folder / name).unlink()
    edit_yaml(folder / "run.yaml", calibration=None)
    text = words(write_report(folder).read_text())
    assert "error of the calibration not recorded" in text


HOSTILE = "\"'><script>bad()</script>$_{[&"


def test_text_from_a_run_cannot_become_markup(make_run, tmp_path):
    # of another version
    unknown = [{"name": HOSTILE, "difference": 0.0, "spread": 0.0}]
    folder = make_run(
        tmp_path, reason=HOSTILE, outcome="edges_apart", witnesses=unknown
    )
    hostile = {"strip": HOSTILE, "policy": HOSTILE, "provenance": {HOSTILE: HOSTILE}}
    edit_yaml(folder / "run.yaml", **hostile)
    checks = [{"name": HOSTILE, "reason": HOSTILE}]
    events = (
        {"t": 1.0, "kind": HOSTILE, "of": HOSTILE},
        {"t": 0.0, "kind": "preflight", "checks": checks},
    )
    (folder / "events.jsonl").write_text("\n".join(map(json.dumps, events)))
    compared = write_comparison([folder, folder], tmp_path / "compare.html")
    listed = write_runs_page([read_row(folder)], tmp_path / "runs.html")
    for made in (write_report(folder), compared, listed):
        text = made.read_text("utf-8")
        assert "<script>bad" not in text
        assert HOSTILE.split("$")[0] in words(text)
        parsed = outline(text)
        assert (parsed.open, parsed.crossed) == ([], [])


@pytest.fixture
def predicting(make_run, tmp_path):
    missed = [{"name": "displacement", "difference": 0.0367, "spread": 0.0009}]
    folder = make_run(tmp_path, foretold=PREDICTED, agreement=UNLIKE, witnesses=missed)
    with (folder / EVENTS).open("a") as events:
        for k in range(60):
            line = {"t": 2.0 + 0.05 * k, "kind": "foretold", **PREDICTED}
            events.write(json.dumps(line) + "\n")
    return folder


def test_page_states_and_draws_what_was_predicted(predicting) -> None:
    page = write_report(predicting).read_text()
    text = words(page)
    assert "+0.4 mm ± 0.9 mm" in text
    assert "This strip does not behave like the model" in text
    assert "strip beside its model 3.1 mm" in text
    assert "Not as usual: the layers touch +36.7 mm from the prediction, up to" in text
    assert "layers, against their prediction +36.7 mm too far, up to 1.8 mm" in text
    assert "predicted 60 times" in text
    assert "foretold" not in text
    assert page.count("<svg") == 3


def test_page_shows_quality_scale_and_plane(calibration, tmp_path):
    path = tmp_path / "calibration.yaml"
    save_calibration(calibration, path)
    done = invoke(f"report {path}")
    assert done.exit_code == 0, done.output
    page = tmp_path / "calibration.html"
    assert done.stdout.strip() == str(page)
    text = page.read_text()
    assert outline(text).open == outline(text).crossed == []
    assert f"{calibration.residual_mm:.2f} mm" in words(text)
    near = calibration.to_image([[0.3, 0.1], [0.301, 0.1]])
    scale = 1.0 / (near[1, 0] - near[0, 0])
    shown = float(re.search(r"z 100 mm (\d\.\d) mm", words(text))[1])
    assert shown == pytest.approx(scale, abs=0.05)
    assert "verdict good" in text
    assert "Lines every 100&nbsp;mm" not in text
    seen = np.full((720, 1280, 3), 90, np.uint8)
    cv2.imwrite(str(tmp_path / "picture.png"), seen)
    text = write_calibration_report(path).read_text()
    assert "Lines every 100&nbsp;mm" in text
    drawn = text.partition("data:image/jpeg;base64,")[2].partition('"')[0]
    image = cv2.imdecode(
        np.frombuffer(base64.b64decode(drawn), np.uint8), cv2.IMREAD_GRAYSCALE
    )
    for x, z in ((0.2, 0.1), (0.4, 0.25), (0.5, 0.0)):
        column, row = calibration.to_image([[x, z]])[0].round().astype(int)
        assert image[row - 2 : row + 3, column - 2 : column + 3].max() > 180
