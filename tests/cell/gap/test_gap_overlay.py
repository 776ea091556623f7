"""overlay.rrd: what was measured, before and after, as a reader of the recording finds
it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from cell.gap.report.figures import Replay, worst_moment, worst_picture
from cell.gap.report.overlay import write_recording
from cell.gap.report.page import page
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.scenes import DISTANCE_SIGNAL
from cell.gap.subject.strip.subject import StripSubject, open_strip
from cell.gap.subject.strip.synthetic import BENCH
from cell.gap.subject.subject import Request, Scene
from drivers.base.types import Array
from tests.support.curves import Curves, bump, hidden, judged
from tests.support.gap_strip_cases import STRIP, folds, written

SOFT = 0.85  # times the stated bending length


@dataclass(frozen=True)
class Rows:
    """The moving rows of one entity: times (m,) [s] and their values."""

    t: Array
    values: list[object]


def read(path: Path) -> dict[str, Rows]:
    """All that moves in a recording, by entity, without the escapes of titles."""
    found: dict[str, list[tuple[float, object]]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.is_static or "t" not in chunk.timeline_names:
            continue
        batch = chunk.to_record_batch()
        names = [n for n in batch.schema.names if n.split(":")[-1] in MOVING]
        if not names:  # what is cleared at the end
            continue
        (name,) = names
        times = np.array(batch["t"].cast("int64")) * 1e-9
        rows = found.setdefault(chunk.entity_path.replace("\\", ""), [])
        rows += zip(times.tolist(), batch[name].to_pylist(), strict=True)
    ordered = {
        entity: sorted(rows, key=lambda row: row[0]) for entity, rows in found.items()
    }
    return {
        entity: Rows(np.array([t for t, _ in rows]), [value for _, value in rows])
        for entity, rows in ordered.items()
    }


MOVING = {"strips", "positions", "scalars", "text"}


def numbers(rows: Rows) -> Array:
    return np.array([value[0] for value in rows.values])  # type: ignore[index]


def simulated(strip: StripSubject, **changes: float) -> Sequence[Scene | None]:
    start = {p.name: p.start for p in strip.scope.base} | changes
    base = np.array([start[p.name] for p in strip.scope.base])
    return strip.draw_simulated(
        [Request(run, base, {}, np.zeros(len(run.local))) for run in strip.runs]
    )


@pytest.fixture(scope="module")
def strip(tmp_path_factory: pytest.TempPathFactory) -> StripSubject:
    """Two folds of the strip exactly as its file states it."""
    root = tmp_path_factory.mktemp("folds") / "runs"
    written(root, folds(["normal", "taut-lift"]))
    return open_strip(STRIP, find_runs([root]))


WORDS = ("measured", "before", "after")


@pytest.fixture(scope="module")
def replays(strip: StripSubject) -> list[Replay]:
    """Before: a strip that is too soft; after: the right one."""
    before = simulated(strip, bending_length=SOFT * strip.file.bending_length)
    drawn = zip(
        map(strip.draw_measured, strip.runs), before, simulated(strip), strict=True
    )
    return [
        Replay(run.name, run.name == "00-normal", dict(zip(WORDS, scenes, strict=True)))
        for run, scenes in zip(strip.runs, drawn, strict=True)
    ]


@pytest.fixture(scope="module")
def recording(replays: list[Replay], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "overlay.rrd"
    write_recording("denim", replays, path, "named")
    return path


def test_measured_points_stand_where_they_were_measured(recording, replays) -> None:
    rows = read(recording)["/00-normal/world/curve/measured"]
    curve = replays[0].measured.curve
    np.testing.assert_allclose(rows.t[1:], curve.t[1:], atol=1e-8)
    assert rows.t[0] == 0.0
    for drawn, points in zip(rows.values, curve.points, strict=True):
        np.testing.assert_allclose(np.array(drawn)[:, [0, 2]], points, atol=1e-6)


def test_the_right_model_lies_on_the_measured_midline(recording) -> None:
    rows = read(recording)
    before, after = (
        numbers(rows[f"/00-normal/signals/{DISTANCE_SIGNAL}/{word}"])
        for word in ("before", "after")
    )
    assert np.median(after) == pytest.approx(1e3 * BENCH.profile, rel=0.25)
    assert np.quantile(before, 0.9) > 2.0 * np.quantile(after, 0.9)
    line = np.array(rows["/00-normal/world/curve/after"].values[-1][0])[:, [0, 2]]
    points = np.array(rows["/00-normal/world/curve/measured"].values[-1])[:, [0, 2]]
    off = np.hypot(*(points[:, None] - line[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.median(off) < 0.004


def test_worst_moment_is_that_at_which_the_soft_strip_is_farthest_off(replays) -> None:
    worst = worst_moment(replays)
    assert worst is not None
    measured = worst.run.measured.curve
    assert worst.t == measured.t[worst.image]
    assert worst.off["before"] > 2.0 * worst.off["after"]
    for run in replays:
        for key, points in enumerate(run.measured.curve.points):
            line = run.scenes["before"].curve.points[key]
            apart = np.hypot(*(points[:, None] - line[None]).transpose(2, 0, 1))
            rms = np.sqrt(np.mean(apart.min(axis=1) ** 2))
            assert rms <= worst.off["before"] + 1e-12
    assert "measured" in worst_picture(worst)


def test_page_says_one_number_everywhere() -> None:
    findings, verdict = judged(Curves(hidden(bump, 0.3)))
    plain = unescape(re.sub(r"<[^>]+>", " ", page(findings, verdict)))
    text = " ".join(plain.split())
    ((name, value),) = verdict.effects[0].parameters.items()
    size, low = (f"{1e3 * v:.3g}" for v in (value.value, value.low))
    assert f"{name} {size} [{low}," in text  # headline
    assert f"({verdict.effects[0].name}: {name} {size} mm)" in text  # sentence
    assert f"{name} {size} mm {low} to" in text  # table
