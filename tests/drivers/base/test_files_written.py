"""Whatever is written goes through one door: whole or not at all, and never along a
link.
"""

import ast
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.files import (
    append_line,
    change_file,
    check_writable,
    new_folder,
    replace_file,
    replacing,
)
from tests.support.dying import no_room

ROOT = Path(__file__).parents[3]
DOOR = "drivers/base/files.py"
WRITES = {
    "write_text",
    "write_bytes",
    "imwrite",
    "FileSink",
    "mkstemp",
    "NamedTemporaryFile",
}
ELSEWHERE = {
    # scratch folders that a program made for itself a moment ago, and its own cache
    "cell/gap/fitting/__init__.py",
}
MADE_BY_THE_DOOR = {
    # a name that `replacing` made or `check_writable` looked at, or memory
    *("cell/record/tables.py", "cell/report/viz/saving.py"),
    *("cell/record/exchange/mcap_file.py", "cell/record/film.py"),
    "policies/adaptive/train/shard.py",
}


def writes(path: Path) -> list[str]:
    """Calls in a module that open a file for writing by themselves."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        method = isinstance(node.func, ast.Attribute)
        name = node.func.attr if method else getattr(node.func, "id", "")
        given = [a.value for a in node.args if isinstance(a, ast.Constant)]
        mode = next(
            (m for m in given if isinstance(m, str) and set(m) & set("wax")), ""
        )
        if name in WRITES or (name == "open" and set(mode) <= set("wxab+") and mode):
            found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {name}")
    return found


def test_nothing_in_the_project_opens_a_file_for_writing_by_itself() -> None:
    allowed = ELSEWHERE | MADE_BY_THE_DOOR | {DOOR}
    files = [
        p
        for room in ("cell", "drivers", "calibration", "policies")
        for p in sorted((ROOT / room).rglob("*.py"))
    ]
    found = [
        w for p in files if str(p.relative_to(ROOT)) not in allowed for w in writes(p)
    ]
    assert found == []


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A file beside the folder that is written into."""
    path = tmp_path / "outside.txt"
    path.write_text("mine")
    return path


def test_replacing_a_link_leaves_alone_where_it_leads(
    tmp_path: Path, outside: Path
) -> None:
    place = tmp_path / "file"
    for name in ("file", "file.part", ".file.part"):
        (tmp_path / name).symlink_to(outside)
    replace_file(place, b"new")
    assert (outside.read_text(), place.read_bytes()) == ("mine", b"new")
    assert not place.is_symlink()


def test_a_line_is_not_added_along_a_link_nor_to_a_pipe(
    tmp_path: Path, outside: Path
) -> None:
    (tmp_path / "link").symlink_to(outside)
    os.mkfifo(tmp_path / "pipe")
    for name in ("link", "pipe"):
        with pytest.raises(OSError, match=r"symbolic|regular|device"):
            append_line(tmp_path / name, b"line\n")
        with pytest.raises(OSError, match=r"symbolic|regular|device"):
            check_writable(tmp_path / name)
    assert outside.read_text() == "mine"


def test_a_line_that_does_not_fit_leaves_no_half_of_it(
    outside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", no_room)
    with pytest.raises(OSError, match="No space"):
        append_line(outside, b"line\n")
    assert outside.read_text() == "mine"


def test_what_fails_on_the_way_leaves_the_old_file_and_nothing_else(
    tmp_path: Path,
) -> None:
    place = tmp_path / "file"
    place.write_text("old")
    with pytest.raises(FileNotFoundError), replacing(place) as scratch:
        scratch.unlink()
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert place.read_text() == "old"


@pytest.mark.parametrize("end", [KeyboardInterrupt, ConfigurationError])
def test_folder_that_ends_early_leaves_nothing_and_blocks_nothing(
    tmp_path: Path, end
) -> None:
    place = tmp_path / "runs" / "made"

    def fail(folder: Path) -> None:
        (folder / "half").touch()
        raise end

    with pytest.raises(end), new_folder(place) as made:
        fail(made)
    assert list(tmp_path.iterdir()) == []
    with new_folder(place) as made:
        (made / "whole").touch()
        assert not place.exists()
    assert [path.name for path in place.iterdir()] == ["whole"]
    with pytest.raises(ConfigurationError, match="is there already"), new_folder(place):
        pytest.fail("was made")


def test_changes_of_one_file_at_once_are_all_kept(tmp_path: Path) -> None:
    place = tmp_path / "file"
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda n: change_file(place, lambda old: f"{old}{n}"), range(8)))
    assert sorted(place.read_text()) == list("01234567")
