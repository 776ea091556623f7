"""What accept, undo and advise find in their folder is checked before it is used."""

import hashlib
import json

import pytest

from cell.gap.verdict.accept import accept, undo
from cell.gap.verdict.schema import read_verdict
from drivers.base.errors import ConfigurationError
from tests.support.gap_strip_cases import EFFECT, Fitted


@pytest.fixture
def fitted(tmp_path) -> Fitted:
    return Fitted(tmp_path)


def test_accepting_changes_the_lines_that_it_changes_and_they_come_back(fitted) -> None:
    before = fitted.file.read_text()
    accept(fitted.out, fitted.file, fitted.cell)
    after = fitted.file.read_text().splitlines()
    gone = [line for line in before.splitlines() if line not in after]
    assert gone == ["bending_length: 0.0170"]
    assert "bending_length: 0.0168" in after
    undo(fitted.out, fitted.file, fitted.cell)
    assert fitted.file.read_text() == before
    with pytest.raises(ConfigurationError, match="nothing to undo"):
        undo(fitted.out, fitted.file, fitted.cell)


def test_what_is_only_suspected_is_accepted_by_force_alone(fitted) -> None:
    (fitted.out / "patch.yaml").rename(fitted.out / "suspect-patch.yaml")
    with pytest.raises(ConfigurationError, match="effects are suspected"):
        accept(fitted.out, fitted.file, fitted.cell)
    assert accept(fitted.out, fitted.file, fitted.cell, force=True).effects == tuple(
        EFFECT
    )


BROKEN = {
    "a patch that is not UTF-8": ("patch.yaml", b"\xff\xfe"),
    "a patch whose effects are no mapping": (
        "patch.yaml",
        b"schema: 1\nname: denim\neffects: 3\n",
    ),
    "a patch of unknown effects": (
        "patch.yaml",
        b"schema: 1\neffects: {magic: {a: 1.0}}\n",
    ),
    "a patch of effects for the cell that is a list": ("cell-patch.yaml", b"- 1\n"),
    "a patch of numbers for the cell": (
        "cell-patch.yaml",
        b"effects: {desk_tilt: 3}\n",
    ),
    "a patch of unknown effects for the cell": (
        "cell-patch.yaml",
        b"effects: {magic: {a: 1.0}}\n",
    ),
    "an empty record of the fit": ("fit.json", b""),
    "a record of the fit that is a list": ("fit.json", b"[1]"),
    "a record of the fit nested without end": ("fit.json", b"[" * 100_000),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_patch_changes_no_file(fitted, name) -> None:
    file, content = BROKEN[name]
    (fitted.out / file).write_bytes(content)
    before = fitted.file.read_bytes(), fitted.cell.read_bytes()
    with pytest.raises(ConfigurationError):
        accept(fitted.out, fitted.file, fitted.cell)
    assert (fitted.file.read_bytes(), fitted.cell.read_bytes()) == before


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}",
        b"[]",
        b"\xff",
        b'{"before": [], "after": {}}',
        b'{"before": {"a": 1}}',
    ],
)
def test_undo_of_a_foreign_acceptance_is_refused(fitted, content) -> None:
    (fitted.out / "accepted.json").write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"accepted\.json: "):
        undo(fitted.out, fitted.file, fitted.cell)


def test_undo_writes_only_the_files_that_it_was_given(fitted, tmp_path) -> None:
    other = tmp_path / "other"
    other.write_text("mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    names = {str(fitted.file.resolve()): "x", str(other): "overwritten"}
    after = {
        str(fitted.file.resolve()): hashlib.sha256(fitted.file.read_bytes()).hexdigest()
    }
    stored = {"before": names, "after": {**after, str(other): digest}}
    (fitted.out / "accepted.json").write_text(json.dumps(stored))
    with pytest.raises(ConfigurationError, match="neither --strip nor the cell file"):
        undo(fitted.out, fitted.file, fitted.cell)
    assert other.read_text() == "mine"


@pytest.mark.parametrize(
    "content", [None, b"", b"{}", b"[]", b"\xff", b'{"schema": 9}']
)
def test_a_verdict_that_cannot_be_read_is_refused_in_own_words(fitted, content) -> None:
    path = fitted.out / "verdict.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigurationError) as caught:
        read_verdict(path)
    assert str(caught.value).startswith(str(path))
    assert "pydantic" not in str(caught.value)
