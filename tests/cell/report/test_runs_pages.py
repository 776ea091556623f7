"""Pages on several runs: the list and the comparison, and the links between pages."""

import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cell.record.documents import annotate
from cell.record.listing import list_runs, read_row
from cell.report.page import setting_text, write_report
from cell.report.runs_page import distinct_texts
from drivers.base.errors import ConfigurationError
from tests.support.commands import invoke
from tests.support.run_edits import edit_column, edit_yaml


@pytest.fixture(scope="module")
def written(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three runs with pages; the second has another policy, the third
    died.
    """
    runs, folders = tmp_path_factory.mktemp("written") / "runs", []
    for number in range(3):
        place = runs / f"2026112{number}T080000Z-denim-fold-000{number}"
        shutil.copytree(finished, place)
        folders.append(place)
    edit_yaml(folders[1] / "run.yaml", policy="circular", seed=3)
    (folders[2] / "result.yaml").unlink()
    for folder in folders:
        write_report(folder)
    return runs


@pytest.fixture
def own(written: Path, tmp_path: Path) -> Path:
    """A copy of them."""
    return shutil.copytree(written, tmp_path / "own")


@pytest.fixture
def three(own: Path) -> list[Path]:
    """The folders of the copy."""
    return sorted(own.iterdir())


def call(*words: object) -> str:
    done = invoke(*words)
    assert done.exit_code == 0, done.output
    return done.stdout


def links(page: Path) -> list[Path]:
    found = re.findall(r'<a href="([^"]+)"', page.read_text("utf-8"))
    return [(page.parent / href).resolve() for href in found]


def test_comparison_has_every_run_and_what_differs(
    own: Path, three: list[Path], monkeypatch
) -> None:
    monkeypatch.chdir(own.parent)
    for folder in three:
        (folder / "truth.yaml").write_text(
            "{schema: 1, displacement: 0.0, edge_offset: 0.0}\n"
        )
    # no run
    (own.parent / "tables/20270101T080000Z-denim-fold-0001").mkdir(parents=True)
    page = Path(json.loads(call("report 0000 0001 last --json"))["report"]).resolve()
    assert page == own / "compare.html"
    text = page.read_text("utf-8")
    (rows,) = re.findall(r"What was set otherwise.*?</table>", text, flags=re.S)
    assert re.findall(r"<tr><td>([^<]+)", rows) == ["policy", "seed"]
    assert text.count("<svg") == 1
    assert "by the camera: 0000" in text
    assert re.search("The paths of 0000 .* and 0001 circular stay within", text)
    assert "The simulated strip itself: 0000" in text
    assert links(page) == [folder / "report.html" for folder in three]
    assert all(path.is_file() for path in links(page))


def test_comparison_says_when_two_paths_part_and_how_far(
    own: Path, three: list[Path]
) -> None:
    edit_column(three[1] / "ticks.parquet", "x", lambda x: x + 0.005 * (x < 0.3))
    call("report", *three[:2])
    text = (own / "compare.html").read_text("utf-8")
    assert re.search(
        r"separate [1-9][\d.]+&nbsp;s after the lift, and are farthest apart, 5.0", text
    )


def test_list_page_has_thumbnails_and_working_links(
    own: Path, three: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "pages" / "runs.html"
    call("runs --runs", own, "--html", out)
    text = out.read_text("utf-8")
    assert text.count('src="data:image/jpeg;base64,') == 3
    assert links(out) == [folder / "report.html" for folder in reversed(three)]
    assert "http" not in re.sub(r"http-equiv|http://www.w3.org", "", text)
    assert "edges apart over the folds" in text
    assert len(text) < 100_000
    assert text.count('type="checkbox"') == 3


@pytest.mark.parametrize("command", ["runs", "report"])
def test_pages_are_never_written_over_a_file_of_the_operator(
    own: Path, three: list[Path], tmp_path: Path, command: str
) -> None:
    mine = tmp_path / "cell.yaml"
    mine.write_text("name: cell\n")
    said = {
        "runs": ("runs --runs", own, "--html", mine),
        "report": ("report", *three, "--out", mine),
    }
    result = invoke(*said[command])
    assert isinstance(result.exception, ConfigurationError)
    assert mine.read_text() == "name: cell\n"


def test_tags_and_notes_stay_in_the_run_and_are_found(
    own: Path, three: list[Path]
) -> None:
    first, *_ = three
    call("note", *three[:2], "--tag good --tag first-day --text 'dry air'")
    call("note", first, "--untag good")
    assert read_row(first).tags == "first-day"
    assert read_row(first).note == "dry air"
    where = "--where \"tags LIKE '%good%'\" --json"
    found = call("runs --runs", own, where)
    assert [json.loads(line)["tags"] for line in found.splitlines()] == [
        ["first-day", "good"]
    ]
    assert [row.tags for row in list_runs(own)] == [
        "first-day",
        "first-day good",
        "",
    ]


@pytest.mark.parametrize("text", ["tags: [", "tags: {a: 1}", "- junk", "schema: 2"])
def test_notes_that_cannot_be_read_are_left_as_they_are(
    three: list[Path], text: str
) -> None:
    first, *_ = three
    notes = first / "notes.yaml"
    notes.write_text(text)
    done = invoke(f"note {first} --tag good")
    assert isinstance(done.exception, ConfigurationError)
    assert str(notes) in str(done.exception)
    assert notes.read_text() == text


def test_four_tags_at_once_are_all_kept(three: list[Path]) -> None:
    first, *_ = three
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda tag: annotate(first, [tag]), "abcd"))
    assert read_row(first).tags == "a b c d"


def test_effects_of_any_text_and_differences_beyond_the_shown_digits_are_stated():
    key = "strip_file.effects.seam.factor"
    assert [setting_text(key, value) for value in (2.0, "abc", [1, 2])] == [
        "2",
        "abc",
        "1, 2",
    ]
    densities = [{"areal_density": 0.3512}, {"areal_density": 0.3508}]
    assert distinct_texts("areal_density", densities) == ["0.3512", "0.3508"]
