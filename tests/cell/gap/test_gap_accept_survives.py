"""An acceptance that dies at any moment, or meets another, loses no file and claims
nothing.
"""

import errno
import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import yaml

from cell.gap.verdict import accept as acceptance
from drivers.base import files
from drivers.base.errors import ConfigurationError
from tests.support.dying import DIED, REFUSED, in_child
from tests.support.fit_folders import CELL, Fitted

pytestmark = pytest.mark.slow


def whole(fit: Fitted) -> tuple[str, str]:
    """Which state each file is in; a file that is neither fails the test."""
    strip, cell = (
        "new" if yaml.safe_load(path.read_text()).get("effects") else "old"
        for path in (fit.file, fit.cell)
    )
    return strip, cell


def moments(
    root: Path, prepare: Callable[[Fitted], object], action: Callable[[Fitted], object]
):
    """Fits after `action` died at its first, second, ... call, until it no longer
    dies.
    """
    for moment in range(200):
        fit = Fitted(root / str(moment), cell=CELL)
        before = fit.stored
        prepare(fit)
        code = in_child(lambda fit=fit: action(fit), dies_at=moment)
        yield fit, before
        if code == 0:
            return
        assert code == DIED
    raise AssertionError("never ended")


def test_acceptance_killed_at_any_moment_can_be_made_again(tmp_path: Path) -> None:
    tried = 0
    for fit, _ in moments(tmp_path, lambda _: None, Fitted.accept):
        tried += 1
        if whole(fit) != ("new", "new"):
            fit.accept()
        assert whole(fit) == ("new", "new")
        fit.undo()
        assert whole(fit) == ("old", "old")
    assert tried > 12


@pytest.mark.parametrize(
    ("prepare", "action"),
    [(lambda _: None, Fitted.accept), (Fitted.accept, Fitted.undo)],
)
def test_acceptance_or_undo_killed_at_any_moment_can_be_undone(
    tmp_path: Path, prepare, action
) -> None:
    for fit, before in moments(tmp_path, prepare, action):
        if fit.record.exists():
            fit.undo()
        assert fit.stored == before


def test_two_acceptances_at_once_leave_one_whole_file(tmp_path: Path) -> None:
    for pair in range(20):
        fit = Fitted(tmp_path / str(pair), cell=CELL)
        children = []
        for _ in range(2):
            pid = os.fork()
            if pid == 0:
                os._exit(in_child(lambda fit=fit: fit.accept()))
            children.append(pid)
        codes = [os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in children]
        assert sorted(codes) == [0, REFUSED]
        assert whole(fit) == ("new", "new")
        assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize("full_at", range(1, 4))
@pytest.mark.parametrize("stays", [False, True])
def test_disk_that_fills_between_two_files_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full_at: int, stays: bool
) -> None:
    fit = Fitted(tmp_path / "fit", cell=CELL)
    before = fit.stored
    full = [False] * (full_at - 1) + [True] + [stays] * 99
    write = files.replace_file

    def until_full(path: Path, *given: object) -> None:
        if full.pop(0):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, *given)

    for module in (acceptance, files):
        monkeypatch.setattr(module, "replace_file", until_full)
    with pytest.raises(ConfigurationError, match="No space"):
        fit.accept()
    monkeypatch.undo()
    if stays:  # nothing could be taken back: the next command does it
        with pytest.raises(ConfigurationError):
            fit.accept(law=True)
    assert fit.stored == before
    assert not fit.record.exists()
    fit.accept()
    assert json.loads(fit.record.read_text())["schema"] == 1


@pytest.mark.parametrize("name", ["denim.yaml", "cell.yaml"])
@pytest.mark.parametrize("moment", range(4))
@pytest.mark.parametrize("taken_back", [False, True])
def test_an_edit_at_any_moment_is_kept_and_the_other_file_is_whole(
    tmp_path: Path, name: str, moment: int, taken_back: bool
) -> None:
    fit = Fitted(tmp_path, cell=CELL)
    if taken_back:
        fit.accept()
    edited, left = tmp_path / name, [moment]
    sync = os.fsync

    def edits(handle: int) -> None:
        sync(handle)
        if left[0] == 0:
            edited.write_text(edited.read_text() + "# weighed again\n")
        left[0] -= 1

    with pytest.MonkeyPatch.context() as patched, suppress(ConfigurationError):
        patched.setattr(os, "fsync", edits)
        fit.undo() if taken_back else fit.accept()
    assert edited.read_text().endswith("# weighed again\n") == (left[0] < 0)
    strip, cell = whole(fit)
    assert strip == cell
