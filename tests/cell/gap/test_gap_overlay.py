"""overlay.rrd: what was measured, before and after, as a reader of the recording finds
it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import unescape
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from cell.gap.report.figures import DrawnVerdict, RunScenes, worst_moment, worst_picture
from cell.gap.report.overlay import write_recording
from cell.gap.report.page import page
from cell.gap.report.sentence import number_text
from cell.gap.subject.strip.subject import DISTANCE_SIGNAL, StripSubject
from cell.gap.subject.strip.synthetic import BENCH
from cell.gap.subject.subject import Origin, Scene
from cell.gap.verdict.decision import next_steps
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from drivers.base.types import Array
from tests.support.curves import Curves, bump, hidden, judged, nothing
from tests.support.gap_strip_cases import folds, opened, written

SOFT = 0.85  # times the stated bending length


@dataclass(frozen=True)
class Told:
    """A verdict with the HTML of its page, and how a person reads that."""

    findings: Findings
    verdict: Verdict
    html: str

    @property
    def text(self) -> str:
        """All words of the page, apart by single blanks."""
        return _words(self.html)

    def rows(self, head: str) -> list[list[str]]:
        """Rows of the table whose head begins with these words, none without it."""
        for table in re.findall(r"<table.*?</table>", self.html, re.DOTALL):
            first, *others = re.findall(r"<tr.*?</tr>", table, re.DOTALL)
            if _words(first).startswith(head):
                cells = (re.findall(r"<td.*?</td>", r, re.DOTALL) for r in others)
                return [[_words(cell) for cell in row] for row in cells]
        return []


def _words(html: str) -> str:
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())


def moving(path: Path, entity: str) -> tuple[Array, list[Any]]:
    """Times (m,) [s] and values of what moves at an `entity` of a recording."""
    rows = []
    for chunk in RrdReader(path).stream().to_chunks():
        here = chunk.entity_path.replace("\\", "") == entity  # as titles are escaped
        if here and not chunk.is_static:
            batch = chunk.to_record_batch()
            times = np.array(batch["t"].cast("int64")) * 1e-9
            for name in batch.schema.names:
                if name.split(":")[-1] in MOVING:
                    rows += zip(times, batch[name].to_pylist(), strict=True)
    times, values = zip(*sorted(rows, key=itemgetter(0)), strict=True)
    return np.array(times), [*values]


MOVING = {"strips", "positions", "scalars"}


def apart(points: Array, line: Array) -> Array:
    """Distances (n,) [m] of points (n, 2) from the nearest node of a line."""
    return np.hypot(*(points[:, None] - line[None]).transpose(2, 0, 1)).min(axis=1)


def simulated(strip: StripSubject, **changes: float) -> Sequence[Scene | None]:
    base = np.array([changes.get(p.name, p.start) for p in strip.scope.base])
    return strip.draw_simulated(
        [replace(strip.stated(run), base=base) for run in strip.runs]
    )


@pytest.fixture(scope="module")
def strip(tmp_path_factory: pytest.TempPathFactory) -> StripSubject:
    """Two folds of the strip exactly as its file states it."""
    root = tmp_path_factory.mktemp("folds") / "runs"
    written(root, folds(["normal", "taut-lift"]))
    return opened(root)


WORDS = ("measured", "before", "after")


@pytest.fixture(scope="module")
def replays(strip: StripSubject) -> list[RunScenes]:
    """Before: a strip that is too soft; after: the right one."""
    before = simulated(strip, bending_length=SOFT * strip.file.bending_length)
    drawn = zip(
        map(strip.draw_measured, strip.runs), before, simulated(strip), strict=True
    )
    return [
        RunScenes(run.name, True, dict(zip(WORDS, scenes, strict=True)))
        for run, scenes in zip(strip.runs, drawn, strict=True)
    ]


@pytest.fixture(scope="module")
def recording(
    replays: list[RunScenes], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("recording") / "overlay.rrd"
    write_recording("denim", replays, path, "named")
    return path


def test_measured_points_stand_where_they_were_measured(recording, replays) -> None:
    t, shown = moving(recording, "/00-normal/world/curve/measured")
    curve = replays[0].measured.curve
    np.testing.assert_allclose(t[1:], curve.t[1:], atol=1e-8)
    assert t[0] == 0.0
    for drawn, points in zip(shown, curve.points, strict=True):
        np.testing.assert_allclose(np.array(drawn)[:, [0, 2]], points, atol=1e-6)


def test_the_right_model_lies_on_the_measured_midline(recording) -> None:
    before, after = (
        moving(recording, f"/00-normal/signals/{DISTANCE_SIGNAL}/{word}")[1]
        for word in ("before", "after")
    )
    assert np.median(after) == pytest.approx(1e3 * BENCH.profile, rel=0.25)
    assert np.quantile(before, 0.9) > 2.0 * np.quantile(after, 0.9)
    *_, (line,) = moving(recording, "/00-normal/world/curve/after")[1]
    *_, points = moving(recording, "/00-normal/world/curve/measured")[1]
    shown, seen = (np.array(each)[:, [0, 2]] for each in (line, points))
    assert np.median(apart(seen, shown)) < 0.004


def test_worst_moment_is_that_at_which_the_soft_strip_is_farthest_off(replays) -> None:
    worst = worst_moment(replays)
    measured = worst.run.measured.curve
    assert worst.t == measured.t[worst.image]
    assert worst.off["before"] > 2.0 * worst.off["after"]
    for run in replays:
        curves = (run.scenes[word].curve.points for word in ("measured", "before"))
        for points, line in zip(*curves, strict=True):
            rms = np.sqrt(np.mean(apart(points, line) ** 2))
            assert rms <= worst.off["before"] + 1e-12
    assert "measured" in worst_picture(worst)


JUDGED = {
    "named": Curves(hidden(bump, 0.3)),
    "ambiguous": Curves(hidden(bump, 0.05), names=("bump", "twin", "wave")),
    "no_gap": Curves(nothing, repeats=1),
    "unexplained": Curves(hidden(bump, 5.005)),  # at the end of what is tried
}


@pytest.fixture(scope="module", params=JUDGED)
def told(request: pytest.FixtureRequest) -> Told:
    """A verdict of each kind and its page, whose next step is decided."""
    findings, verdict = judged(JUDGED[request.param])
    first, *others = next_steps(
        findings.decision, verdict, Path("out"), Origin("--model arm.yaml")
    )
    verdict = verdict.model_copy(update={"next": first, "alternatives": others})
    assert verdict.verdict == request.param
    return Told(findings, verdict, page(findings, verdict))


def test_page_says_one_number_everywhere(told: Told) -> None:
    listed = {row[0]: row[1] for row in told.rows("what is missing")}
    verdict, sizes = told.verdict, {}
    found = (("", verdict.effects), ("suspected, ", verdict.suspected))
    for doubt, effects in found:
        for effect in effects:
            value = effect.parameters["size"]
            size = number_text(1e3 * value.value)
            sizes[f"{doubt}{effect.name}: size"] = f"{size} mm"
            if not doubt:
                assert f"size {size} [{1e3 * value.low:.3g}," in told.text  # headline
                assert f"({effect.name}: size {size} mm)" in told.text  # sentence
                sure = f"{100 * effect.confidence:.0f} % sure"  # large print
                assert sure in told.text
    assert listed == sizes


def test_the_table_of_held_out_runs_states_the_gap_of_the_card(told: Told) -> None:
    gap, (row,) = told.verdict.gap, told.rows("rms")
    fits = ("before", "after")[: 1 + told.findings.held_out_fits.changed]
    shown = [float(each) for each in row[1 : 1 + len(fits)]]
    stated = [getattr(gap, fit)["angle_mrad"] for fit in fits]
    assert shown == pytest.approx(stated, rel=5e-3)
    beyond = [float(each) for each in row[-1].split(" then ")]
    excess = [getattr(gap, fit)["excess"] for fit in fits]
    assert beyond == pytest.approx(excess, rel=5e-2, abs=0.1)
    if len(fits) > 1 and gap.before["excess"]:
        assert f"{gap.before['excess']:.2g} sigma off" in told.text
    assert ("No held-out run leaves more than noise" in told.text) == (not any(excess))


def test_bars_of_a_verdict_are_its_residuals_over_their_noise(told: Told) -> None:
    gap = told.verdict.gap
    bars = DrawnVerdict(**dict(told.verdict)).plot().axes[0].patches
    sizes = [
        side["angle_mrad"] / gap.floor["angle_mrad"] for side in (gap.before, gap.after)
    ]
    assert [bar.get_width() for bar in bars] == pytest.approx(sizes)


def test_effects_that_change_nothing_are_listed_and_no_others(told: Told) -> None:
    dead = "Changes nothing in these runs: dead."
    assert (dead in told.text) == (told.verdict.verdict != "ambiguous")


def test_an_all_clear_counts_what_its_table_lists_and_says_what_it_does_not(
    told: Told,
) -> None:
    limits = told.verdict.detectable
    assert {row[0] for row in told.rows("effect would have shown")} == {*limits}
    untested = {each.what: each.why for each in told.verdict.untested}
    assert dict(told.rows("not tested by these runs")) == untested
    without_name = told.verdict.verdict in ("no_gap", "unexplained")
    assert bool(untested) == without_name
    card = f"These runs could not show: {', '.join(untested)}."
    assert (card in told.text) == without_name
    if told.verdict.verdict == "no_gap":
        usual = {*limits}.difference(untested)
        assert f"{len(usual)} effects would have shown below" in told.text


def test_page_and_command_offer_the_steps_of_the_verdict_alone(told: Told) -> None:
    steps = told.verdict.steps
    for step in steps:
        assert step.sentence.replace("`", "")[1:] in told.text
    forced = any("--force" in step.command for step in steps)
    assert ("--force" in told.text) == forced
    assert not forced
