"""Pages in a reader's browser: on a phone and on a desk, by day and by night, nothing is wrong."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from cell.gap.report.page import write_report as write_gap_report
from cell.record.listing import list_runs
from cell.report.compare import write_comparison
from cell.report.page import write_report
from cell.report.runs_page import write_runs_page
from tests.cell.gap.test_gap_engine import Curves, bump, hidden, judged
from tests.support.browser import FOUND, LOOKS, Browser, browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(FOUND is None, reason="no Chromium is installed here"),
]


@pytest.fixture(scope="module")
def reader() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def pages(finished: Path, killed: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    place = tmp_path_factory.mktemp("pages")
    gap = place / "gap.html"
    write_gap_report(*judged(Curves(hidden(bump, 0.3))), gap)
    compared = write_comparison([finished, killed], place / "compare.html")
    listed = write_runs_page(list_runs(finished.parent), place / "runs.html")
    return [write_report(finished), write_report(killed), gap, compared, listed]


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: f"{look.width}-{look.scheme}")
def test_pages_show_no_error_no_overflow_and_text_that_can_be_read(
    look, pages: list[Path], reader: Browser
) -> None:
    found = {page.name: reader.problems(page, look) for page in pages}
    assert not {name: problems for name, problems in found.items() if problems}


def test_what_is_wrong_is_found(tmp_path: Path, reader: Browser) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        "<p style='color:#999'>faint</p><p style='font-size:7px'>small</p>"
        "<img src='none.png'><div style='width:3000px'>wide</div><script>nothing()</script>"
        "<svg width=100 height=20><rect width=100 height=20 fill='#222'/>"
        "<text y=14 fill='#111'>hidden</text></svg>"
        "<table><td style='overflow-wrap:anywhere;width:1px'>one word below the other<td>x</table>"
    )
    found = " ".join(reader.problems(page, LOOKS[0]))
    for word in ("faint text, contrast 2.8", "small text 7.0", "broken picture", "overflow: 3",
                 "Uncaught", "hidden", "squeezed cell"):  # fmt: skip
        assert word in found, word
