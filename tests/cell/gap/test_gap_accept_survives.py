"""An acceptance that dies at any moment, or meets another, loses no file and claims
nothing.
"""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from cell.gap.verdict import accept as acceptance
from cell.gap.verdict.accept import accept, undo
from drivers.base.errors import ConfigurationError
from tests.support.gap_strip_cases import Fitted

pytestmark = pytest.mark.slow

DIED, REFUSED = 9, 2
CELL = {"effects": {"desk_tilt": {"angle": 0.004}}}


def fitted_both(root: Path) -> Fitted:
    """A fit that patches the strip and the cell file."""
    root.mkdir(exist_ok=True)
    made = Fitted(root)
    (made.out / "cell-patch.yaml").write_text(yaml.safe_dump(CELL))
    return made


def in_child(action: Callable[[], object], *, dies_at: int | None = None) -> int:
    """Exit code of `action` in a process of its own, killed before its system call
    `dies_at`.
    """
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            if dies_at is not None:
                count_down(dies_at)
            action()
            code = 0
        except ConfigurationError:
            code = REFUSED
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def count_down(left: int) -> None:
    """Let this process die before the call `left` of those that change files."""
    calls = [left]

    def dying(call):
        def stands_in(*given, **named):
            if calls[0] == 0:
                os._exit(DIED)
            calls[0] -= 1
            return call(*given, **named)

        return stands_in

    for name in ("fsync", "replace", "rename", "unlink", "open"):
        setattr(os, name, dying(getattr(os, name)))


def whole(fit: Fitted) -> tuple[str, str]:
    """Which state each file is in; a file that is neither fails the test."""
    strip, cell = (
        yaml.safe_load(fit.file.read_text()),
        yaml.safe_load(fit.cell.read_text()),
    )
    return (
        "new" if strip.get("effects") else "old",
        "new" if cell.get("effects") else "old",
    )


def moments(
    root: Path, prepare: Callable[[Fitted], object], action: Callable[[Fitted], object]
):
    """Fits after `action` died at its first, second, ... call, until it no longer
    dies.
    """
    for moment in range(200):
        fit = fitted_both(root / str(moment))
        before = (fit.file.read_bytes(), fit.cell.read_bytes())
        prepare(fit)
        code = in_child(lambda fit=fit: action(fit), dies_at=moment)
        yield fit, before
        if code == 0:
            return
        assert code == DIED
    raise AssertionError("never ended")


def test_acceptance_killed_at_any_moment_can_be_made_again(tmp_path: Path) -> None:
    tried = 0
    for fit, _ in moments(
        tmp_path, lambda _: None, lambda fit: accept(fit.out, fit.file, fit.cell)
    ):
        tried += 1
        if whole(fit) != ("new", "new"):
            accept(fit.out, fit.file, fit.cell)
        assert whole(fit) == ("new", "new")
        undo(fit.out, fit.file, fit.cell)
        assert whole(fit) == ("old", "old")
    assert tried > 12


def test_acceptance_killed_at_any_moment_can_be_undone(tmp_path: Path) -> None:
    for fit, before in moments(
        tmp_path, lambda _: None, lambda fit: accept(fit.out, fit.file, fit.cell)
    ):
        if (fit.out / "accepted.json").exists():
            undo(fit.out, fit.file, fit.cell)
        assert (fit.file.read_bytes(), fit.cell.read_bytes()) == before


def test_undo_killed_at_any_moment_can_be_finished(tmp_path: Path) -> None:
    for fit, before in moments(
        tmp_path,
        lambda fit: accept(fit.out, fit.file, fit.cell),
        lambda fit: undo(fit.out, fit.file, fit.cell),
    ):
        if (fit.out / "accepted.json").exists():
            undo(fit.out, fit.file, fit.cell)
        assert (fit.file.read_bytes(), fit.cell.read_bytes()) == before


def test_two_acceptances_at_once_leave_one_whole_file(tmp_path: Path) -> None:
    for pair in range(20):
        fit = fitted_both(tmp_path / str(pair))
        children = []
        for _ in range(2):
            pid = os.fork()
            if pid == 0:
                os._exit(in_child(lambda fit=fit: accept(fit.out, fit.file, fit.cell)))
            children.append(pid)
        codes = sorted(
            os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in children
        )
        assert codes == [0, REFUSED]
        assert whole(fit) == ("new", "new")
        assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize("full_at", range(1, 4))
def test_disk_that_fills_between_two_files_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full_at: int
) -> None:
    fit = fitted_both(tmp_path / "fit")
    before = (fit.file.read_bytes(), fit.cell.read_bytes())
    write, written = acceptance.write_file, []

    def until_full(path: Path, text: str) -> None:
        written.append(path)
        if len(written) == full_at:
            raise ConfigurationError(
                f"{path}: cannot be written: {os.strerror(errno.ENOSPC)}"
            )
        write(path, text)

    monkeypatch.setattr(acceptance, "write_file", until_full)
    with pytest.raises(ConfigurationError, match="No space"):
        accept(fit.out, fit.file, fit.cell)
    assert (fit.file.read_bytes(), fit.cell.read_bytes()) == before
    assert not (fit.out / "accepted.json").exists()
    accept(fit.out, fit.file, fit.cell)
    assert json.loads((fit.out / "accepted.json").read_text())["schema"] == 1


def test_another_command_that_changes_the_strip_is_waited_for_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = fitted_both(tmp_path / "fit")
    monkeypatch.setattr("drivers.base.files.LOCK_TIMEOUT", 0.05)
    with (
        acceptance.lock_folders([fit.file.parent]),
        pytest.raises(ConfigurationError, match="another command"),
    ):
        accept(fit.out, fit.file, fit.cell)
