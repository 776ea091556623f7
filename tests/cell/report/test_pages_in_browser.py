"""Pages in a reader's browser: on a phone and on a desk, by day and by night, nothing
is wrong.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.gap.report.page import page as gap_page
from cell.record.listing import list_runs
from cell.record.run import read_run
from cell.record.writer import RunWriter
from cell.report.calibration_page import write_calibration_report
from cell.report.page import write_report
from cell.report.runs_page import write_comparison, write_runs_page
from cell.studies.page import page_of
from drivers.base.types import Frame, Pose
from tests.cell.conftest import HEADER
from tests.support.browser import FOUND, LOOKS, Browser, Look, browser
from tests.support.curves import Curves, bump, hidden, judged
from tests.support.made_results import measured
from tests.support.plain_cell import ARM

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(FOUND is None, reason="no Chromium is installed here"),
]


@pytest.fixture(scope="module")
def reader() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a film, a second of it before its states begin."""
    place = tmp_path_factory.mktemp("filmed")
    writer = RunWriter(place, HEADER, "all", patient=True, film="libx264")
    for k in range(60):
        stamp = k / 30 - 1.0
        image = np.full((72, 128, 3), 4 * k, np.uint8)
        writer.frame(Frame(stamp, stamp + 0.02, "made", k, image))
        writer.tick(
            replace(ARM, stamp=k / 60, pose=Pose(0.6 - 0.01 * k, 0.1, 0.0)), "FOLD"
        )
    writer.finish({"outcome": "path_done"})
    return writer.folder


@pytest.fixture(scope="module")
def pages(
    finished: Path, killed: Path, filmed: Path, tmp_path_factory: pytest.TempPathFactory
) -> list[Path]:
    place = tmp_path_factory.mktemp("pages")
    gap = place / "gap.html"
    gap.write_text(gap_page(*judged(Curves(hidden(bump, 0.3)))), "utf-8")
    compared = write_comparison([finished, killed], place / "compare.html")
    listed = write_runs_page(list_runs(finished.parent), place / "runs.html")
    benchmark = place / "benchmark.html"
    benchmark.write_text(page_of(measured()), "utf-8")
    camera = write_calibration_report(finished / "calibration.yaml")
    reports = map(write_report, (finished, killed, filmed))
    return [benchmark, *reports, gap, compared, listed, camera]


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: f"{look.width}-{look.scheme}")
def test_pages_show_no_error_no_overflow_and_text_that_can_be_read(
    look, pages: list[Path], reader: Browser
) -> None:
    found = {page.name: reader.problems(page, look) for page in pages}
    assert not {name: problems for name, problems in found.items() if problems}


POKE = """document.querySelectorAll('.pad').forEach((pad) => {
  const box = pad.getBoundingClientRect(), at = {bubbles: true, cancelable: true, ctrlKey: true,
    clientX: box.x + 0.4 * box.width, clientY: box.y + 0.5 * box.height, view: window};
  pad.dispatchEvent(new PointerEvent("pointermove", {...at, pointerType: "mouse"}));
  pad.dispatchEvent(new WheelEvent("wheel", {...at, deltaY: -300}));
  pad.dispatchEvent(new PointerEvent("pointermove", {...at, pointerType: "touch"}));
})"""


def test_every_figure_is_read_and_zoomed_without_an_error(
    pages: list[Path], reader: Browser
) -> None:
    for page in pages:
        reader.problems(page, LOOKS[2])
        reader.evaluate(POKE)
        still = (
            "document.querySelectorAll('figure[role=img] svg:not([data-chart])').length"
        )
        assert reader.evaluate(still) == 0, page.name
        assert not reader.complaints, page.name


ACROSS = 0.3  # share of a panel at which it is read


class Chart:
    """The figure called `says` of a page that a reader looks at; `panel` of those it
    can read.
    """

    def __init__(
        self, reader: Browser, page: Path, says: str, panel: int, look: Look = LOOKS[2]
    ) -> None:
        reader.problems(page, look)
        self.reader, self.svg = (
            reader,
            f"document.querySelector('[aria-label*=\"{says}\"] svg')",
        )
        self.pad = f"{self.svg}.querySelectorAll('.pad')[{panel}]"
        reader.evaluate(f"{self.pad}.scrollIntoView({{block: 'center'}})")
        drawn = "requestAnimationFrame(() => requestAnimationFrame(done))"
        # until scrolling was announced
        reader.evaluate(f"new Promise((done) => {drawn})")

    def at(self, across: float, up: float, *kinds: str, **more: Any) -> str:
        """Do `kinds` of things at a place of the panel (shares), and read what the card
        says.
        """
        box = self.box()
        x, y = box["x"] + across * box["width"], box["y"] + (1 - up) * box["height"]
        self.reader.point(x, y, *kinds, **more)
        card = (
            "[...document.querySelectorAll('.reading:not([hidden]) p')].map(p =>"
            " p.innerText)"
        )
        return str(self.reader.evaluate(f"{card}.join('; ').replace(/\\s+/g, ' ')"))

    def read(self) -> str:
        """What the card says at a place of the panel that tests share."""
        return self.at(ACROSS, 0.5, "mouseMoved")

    def zoom(self, across: float) -> None:
        """Zoom in on the share `across` of the panel."""
        self.at(across, 0.5, "mouseWheel", deltaX=0, deltaY=-400, modifiers=2)

    def box(self) -> dict[str, float]:
        """Place of the panel in the window [px]."""
        return self.reader.evaluate(f"{self.pad}.getBoundingClientRect().toJSON()")

    def show_whole(self) -> None:
        """Take the zoom back."""
        click = "dispatchEvent(new Event('click'))"
        self.reader.evaluate(f"{self.svg}.querySelector('.whole').{click}")

    def shape(self) -> str:
        """What the figure shows, without what only follows the pointer."""
        quiet = "querySelectorAll('.rule, .ticks').forEach(e => e.remove())"
        return str(
            self.reader.evaluate(
                f"(c => (c.{quiet}, c.innerHTML))({self.svg}.cloneNode(1))"
            )
        )


@pytest.fixture
def signals(reader: Browser, finished: Path) -> Chart:
    return Chart(reader, write_report(finished), "signals over time", 1)


def limits(page: Path) -> tuple[float, float]:
    """Times [s] at the edges of the signals on a run's page."""
    found = re.findall(r'data-chart="([^"]*)"', page.read_text("utf-8"))
    first, last = json.loads(unescape(found[1]))[1]["x"]["limits"]
    return first, last


def recorded_at(folder: Path, across: float) -> tuple[float, dict[str, float]]:
    """Time [s] at the share `across` of the signals on the page of the run in `folder`,
    and where its gripper was then [mm].
    """
    first, last = limits(folder / "report.html")
    t, ticks = first + across * (last - first), read_run(folder).ticks
    places = {"gripper x": ticks.x, "gripper z": ticks.z}
    return t, {n: 1e3 * np.interp(t, ticks.t, column) for n, column in places.items()}


def millimetres(name: str, said: str) -> float:
    """Number [mm] that a card states of the signal called `name`."""
    return float(re.search(rf"{name} (\S+) mm", said)[1])


def test_pointer_reads_all_signals_of_a_moment_in_their_units(
    signals: Chart, finished: Path
) -> None:
    said = signals.read()
    t, place = recorded_at(finished, ACROSS)
    assert float(re.search(r"t (\S+) s", said)[1]) == pytest.approx(t, abs=0.03)
    for name, wanted in place.items():
        assert millimetres(name, said) == pytest.approx(wanted, abs=2.0)
    assert "FOLD" in said


def test_zoom_is_shared_keeps_values_and_is_taken_back(signals: Chart) -> None:
    before, said = signals.shape(), signals.read()
    signals.zoom(ACROSS)
    zoomed = signals.read()
    assert signals.shape() != before
    parts = (
        "[...new Set([...document.querySelectorAll('.pad')].filter(p =>"
        " p.closest('svg') ==="
    )
    parts = f"{parts} {signals.svg}).map(p => p.__zoom.toString()))].length"
    assert signals.reader.evaluate(parts) == 1
    for name in ("gripper x", "gripper z"):
        was = millimetres(name, said)
        assert millimetres(name, zoomed) == pytest.approx(was, abs=1.0)
    signals.show_whole()
    assert signals.shape() == before


def test_click_on_the_curves_leads_the_film_also_when_zoomed(
    reader: Browser, filmed: Path
) -> None:
    chart = Chart(reader, write_report(filmed), "signals over time", 1)
    first, last = limits(filmed / "report.html")
    wait = (
        "new Promise(r => film.readyState ? r() :"
        " film.addEventListener('loadedmetadata', r))"
    )
    reader.evaluate(f"(film => {wait})(document.querySelector('video'))")
    for across in (0.25, 0.6):
        chart.at(
            across, 0.5, "mousePressed", "mouseReleased", button="left", clickCount=1
        )
        begun = reader.evaluate("document.querySelector('video').currentTime") - 1.0
        assert begun == pytest.approx(first + across * (last - first), abs=0.02)
        chart.zoom(across)
        line = reader.evaluate(
            f"{chart.svg}.querySelector('.now').getBoundingClientRect().x"
        )
        pad = chart.box()
        assert line == pytest.approx(pad["x"] + across * pad["width"], abs=3.0)
        chart.show_whole()


def test_figures_of_a_fold_fit_a_phone_without_scrolling(
    reader: Browser, finished: Path
) -> None:
    assert not reader.problems(write_report(finished), LOOKS[0])
    figures = "[...document.querySelectorAll('figure[role=img]')]"
    assert reader.evaluate(f"{figures}.every(f => f.scrollWidth <= f.clientWidth)")
    chart = Chart(reader, finished / "report.html", "signals over time", 1, LOOKS[0])
    said = chart.read()
    _, place = recorded_at(finished, ACROSS)
    assert millimetres("gripper x", said) == pytest.approx(place["gripper x"], abs=4.0)


def test_what_is_wrong_is_found(tmp_path: Path, reader: Browser) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        "<p style='color:#999'>faint</p><p style='font-size:7px'>small</p><img"
        " src='none.png'><video src='none.mp4'></video><div"
        " style='width:3000px'>wide</div><script>nothing()</script><svg width=100"
        " height=20><rect width=100 height=20 fill='#222'/><text y=14"
        " fill='#111'>hidden</text></svg><table><td"
        " style='overflow-wrap:anywhere;width:1px'>one word below the"
        " other<td>x</table>"
    )
    found = " ".join(reader.problems(page, LOOKS[0]))
    for word in (
        "faint text, contrast 2.8",
        "small text 7.0",
        "broken picture",
        "overflow: 3",
        "film that shows nothing",
        "Uncaught",
        "hidden",
        "squeezed cell",
    ):
        assert word in found, word
