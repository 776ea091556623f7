"""What accept, undo and advise find in their folder is checked before it is used."""

import json
import shutil

import pytest
import yaml

from cell.gap.verdict.accept import accept, undo
from cell.gap.verdict.schema import read_verdict
from drivers.base.errors import ConfigurationError
from tests.support.fit_folders import CELL, EFFECT, Fitted, write_fit
from tests.support.refusals import refusal
from tests.support.run_edits import edit_yaml


@pytest.fixture
def fitted(tmp_path) -> Fitted:
    return Fitted(tmp_path)


def test_accepting_changes_the_lines_that_it_changes_and_they_come_back(fitted) -> None:
    before = fitted.file.read_text()
    fitted.accept()
    after = fitted.file.read_text().splitlines()
    gone = [line for line in before.splitlines() if line not in after]
    assert gone == ["bending_length: 0.0170"]
    assert "bending_length: 0.0168" in after
    fitted.undo()
    assert fitted.file.read_text() == before
    with refusal("nothing to undo"):
        fitted.undo()


def test_what_is_only_suspected_is_accepted_by_force_alone(tmp_path) -> None:
    fitted = Fitted(tmp_path, "accept_suspected")
    with refusal(r"nothing was named.*report\.html"):
        fitted.accept()
    assert fitted.accept(force=True).effects == tuple(EFFECT)


BROKEN = {
    "a patch that is not UTF-8": ("subject", b"\xff\xfe"),
    "a patch whose effects are no mapping": (
        "subject",
        b"schema: 1\nname: denim\neffects: 3\n",
    ),
    "a patch of unknown effects": (
        "subject",
        b"schema: 1\neffects: {magic: {a: 1.0}}\n",
    ),
    "a patch of effects for the cell that is a list": ("cell", b"- 1\n"),
    "a patch of numbers for the cell": ("cell", b"effects: {desk_tilt: 3}\n"),
    "a patch of unknown effects for the cell": (
        "cell",
        b"effects: {magic: {a: 1.0}}\n",
    ),
}
HALVES = {
    "an empty record of the fit": ("fit.json", b""),
    "a record of the fit that is a list": ("fit.json", b"[1]"),
    "a record of the fit nested without end": ("fit.json", b"[" * 100_000),
    "no record of the fit": ("fit.json", None),
    "no verdict": ("verdict.json", None),
    "no patch of the cell": ("cell-patch.yaml", None),
    "no patch": ("patch.yaml", None),
    "a patch that somebody changed": ("patch.yaml", b"name: denim\n"),
}


@pytest.fixture
def fitted_both(tmp_path) -> Fitted:
    """A fit that patches the strip and the cell file."""
    return Fitted(tmp_path, cell=CELL)


def refused(fit: Fitted) -> str:
    """What accepting the fit is refused with; no file changes."""
    before = fit.stored
    with pytest.raises(ConfigurationError) as caught:
        fit.accept()
    assert fit.stored == before
    assert not list(fit.file.parent.glob("*.undo.json"))
    return str(caught.value)


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_patch_changes_no_file(fitted_both, name) -> None:
    role, content = BROKEN[name]
    fitted_both.write(**{role: content})
    assert "patch.yaml: " in refused(fitted_both)


@pytest.mark.parametrize("name", HALVES)
def test_a_part_of_a_fit_is_not_accepted(fitted_both, name) -> None:
    file, content = HALVES[name]
    path = fitted_both.out / file
    path.unlink() if content is None else path.write_bytes(content)
    missing = "is missing; " if content is None else ""
    assert refused(fitted_both).startswith(f"{path}: {missing}")


@pytest.mark.parametrize("name", ["cell", "file"])
def test_a_file_that_changed_since_the_fit_is_refused_by_name(
    fitted_both, name: str
) -> None:
    path = getattr(fitted_both, name)
    stated = path.read_text()
    path.write_text(stated + "# measured again\n")
    assert refused(fitted_both).startswith(f"{path}: has changed since it was fitted")
    path.write_text(stated)
    fitted_both.accept()
    path.write_text(path.read_text() + "# measured again\n")
    with refusal("has changed since the acceptance"):
        fitted_both.undo()


def test_effects_of_the_cell_go_into_the_cell_file(fitted_both) -> None:
    known = {"camera_latency": {"time": 0.02}}
    earlier = {"desk_tilt": {"angle": 0.001}}
    edit_yaml(fitted_both.cell, effects=known | earlier, name="here")
    fitted_both.write()
    with refusal("name the cell file"):
        accept(fitted_both.out, fitted_both.file)
    fitted_both.accept()
    content = yaml.safe_load(fitted_both.cell.read_text())
    assert content["effects"] == known | CELL["effects"]
    assert content["name"] == "here"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}",
        b"[]",
        b"\xff",
        b'{"acceptances": [{"before": [], "after": {}}]}',
        b'{"acceptances": [{"before": {"a": 1}}]}',
    ],
)
def test_undo_of_a_foreign_acceptance_is_refused(fitted, content) -> None:
    fitted.record.write_bytes(content)
    with refusal(r"undo\.json: "):
        fitted.undo()


@pytest.mark.parametrize(
    "name", ["../other", "other", "../other/x-accepted.xml", "/etc/x-accepted.xml"]
)
def test_undo_writes_only_the_files_that_it_was_given(fitted, name) -> None:
    fitted.accept()
    record = fitted.record
    stored = json.loads(record.read_text())
    stored["acceptances"][0]["before"][name] = "overwritten"
    record.write_text(json.dumps(stored))
    with refusal("is neither denim"):
        fitted.undo()


def test_acceptances_on_top_of_each_other_are_undone_in_turn(fitted, tmp_path) -> None:
    texts = [fitted.file.read_text()]
    fitted.accept()
    texts.append(fitted.file.read_text())
    patch = yaml.safe_load(texts[1]) | {"bending_length": 0.0181}
    second = tmp_path / "second"
    write_fit(second, fitted.file, "accept", {"subject": yaml.safe_dump(patch)})
    accept(second, fitted.file)
    with refusal(f"is {second}; undo that one first"):
        fitted.undo()
    for out in (second, fitted.out):
        undo(out, fitted.file)
        assert fitted.file.read_text() == texts.pop()
    assert not list(tmp_path.glob("*.undo.json"))


@pytest.mark.parametrize("gone", [True, False])
def test_undo_needs_nothing_of_the_folder_that_was_accepted(fitted, gone) -> None:
    before = fitted.file.read_bytes()
    fitted.accept()
    shutil.rmtree(fitted.out) if gone else fitted.write()
    fitted.undo()
    assert fitted.file.read_bytes() == before


@pytest.mark.parametrize(
    "content", [None, b"", b"{}", b"[]", b"\xff", b'{"schema": 9}']
)
def test_a_verdict_that_cannot_be_read_is_refused_in_own_words(fitted, content) -> None:
    path = fitted.out / "verdict.json"
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(ConfigurationError) as caught:
        read_verdict(path)
    assert str(caught.value).startswith(str(path))
    assert "pydantic" not in str(caught.value)
