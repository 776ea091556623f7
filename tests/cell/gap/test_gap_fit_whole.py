"""Results of a fit appear whole, whatever happens, and write over nothing of others."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import pytest

import cell.gap.fit as fitting
from cell.gap.fit import fit
from cell.gap.subject.subject import Subject
from cell.gap.verdict import fit_folder
from cell.gap.verdict.accept import accept, undo
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.fit_folder import read_record, results_folder
from cell.gap.verdict.schema import Verdict
from drivers.base.errors import ConfigurationError
from drivers.base.files import lock_folders, write_file
from tests.support.dying import DIED, in_child
from tests.support.fit_folders import Fitted, verdict_of
from tests.support.refusals import refusal
from tests.support.swings import PENDULUM, rubbing, swings_of

OLD, NEW = b"schema: 1\nname: old\n", b"schema: 1\nname: new\n"
NOTE = "what I think of it"


def refitted(folder: Path) -> tuple[Path, Callable[[], None]]:
    """Folder of a fit that is there with a person's note, and the action that replaces
    it.
    """
    made = Fitted(folder, cell={"effects": {}})
    made.write(subject=OLD)
    (made.out / "note.txt").write_text(NOTE)
    del made.contents["cell"]  # of which the next fit has none
    return made.out, lambda: made.write(subject=NEW)


def state(out: Path) -> bytes:
    """Patch of the complete fit in `out`; a mixture of two is refused."""
    with lock_folders([out]):
        read_record(out)
    assert (out / "note.txt").read_text() == NOTE
    patch = (out / "patch.yaml").read_bytes()
    assert (out / "cell-patch.yaml").exists() == (patch == OLD)
    return patch


@pytest.mark.slow
def test_a_fit_that_is_killed_at_any_moment_is_the_old_one_or_the_new(tmp_path) -> None:
    seen = []
    for moment in range(300):
        out, action = refitted(tmp_path / str(moment))
        code = in_child(action, dies_at=moment)
        seen.append(state(out))
        action()  # what was killed blocks nothing
        assert state(out) == NEW
        if code == 0:
            break
        assert code == DIED
    assert seen == sorted(seen, reverse=True)  # old ones, then new ones
    assert set(seen) == {OLD, NEW}
    assert not list(tmp_path.rglob(".fit.part"))


def test_a_first_fit_that_is_killed_blocks_no_second_one(tmp_path) -> None:
    made = Fitted(tmp_path)
    out = made.out = tmp_path / "new"

    def dies() -> None:
        with results_folder(out):
            os._exit(DIED)

    assert in_child(dies) == DIED
    with refusal(r"fit\.json: is missing"):
        accept(out, made.file, made.cell)
    fit_folder.check_replaceable(out)
    made.write()
    accept(out, made.file, made.cell)


@pytest.mark.parametrize("full_at", range(3))
def test_a_disk_that_fills_leaves_the_earlier_fit(
    tmp_path, monkeypatch, full_at: int
) -> None:
    out, action = refitted(tmp_path)
    full = [False] * full_at + [True]

    def until_full(path: Path, content: str | bytes) -> None:
        if full.pop(0):
            raise ConfigurationError(f"{path}: cannot be written: No space left")
        write_file(path, content)

    monkeypatch.setattr("tests.support.fit_folders.write_file", until_full)
    monkeypatch.setattr(fit_folder, "write_file", until_full)
    with refusal("No space"):
        action()
    assert state(out) == OLD
    monkeypatch.undo()
    action()
    assert state(out) == NEW


@pytest.mark.parametrize("name", ["patch.yaml", "report.html", "cell-patch.yaml"])
@pytest.mark.parametrize("during", [False, True])
def test_what_a_person_put_at_the_place_of_a_result_is_kept_and_named(
    tmp_path, monkeypatch, name: str, during: bool
) -> None:
    out, action = refitted(tmp_path)
    path = out / name

    def edited(**facts: object) -> Verdict:
        path.write_text(NOTE)
        return verdict_of(**facts)

    if during:
        monkeypatch.setattr("tests.support.fit_folders.verdict_of", edited)
    else:
        edited()
    with pytest.raises(ConfigurationError) as caught:
        action()
    assert str(caught.value).startswith(f"{path}: was not written by a fit, or was")
    assert path.read_text() == NOTE
    assert (out / "patch.yaml").read_bytes() != NEW


def test_two_fits_into_one_folder_exclude_each_other(tmp_path, monkeypatch) -> None:
    out, action = refitted(tmp_path)
    monkeypatch.setattr("drivers.base.files.LOCK_TIMEOUT", 0.05)
    with (
        results_folder(out),
        refusal("another command has been changing"),
    ):
        action()
    assert state(out) == OLD


@pytest.fixture(scope="module")
def swings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Findings]:
    """Runs of a pendulum that rubs, and what a fit of them found."""

    folder, found = tmp_path_factory.mktemp("swings"), []
    file, runs = swings_of(folder, (0.2, 0.9, 0.2, 0.9), 1, rubbing)
    fit([runs], file, folder / "first", overlay=lambda f, *_: found.append(f))
    return runs, found[0]


@pytest.fixture
def pendulum(swings, tmp_path, monkeypatch) -> Path:
    """The file of a pendulum that a test may change; to fit it takes no time."""
    _, findings = swings
    copytree(PENDULUM, tmp_path, dirs_exist_ok=True)
    monkeypatch.setattr(fitting, "page", lambda *_: "<html>")

    def found(subject: Subject, *_: object) -> Findings:
        return replace(findings, subject=subject)

    monkeypatch.setattr(fitting, "investigate", found)
    return tmp_path / "pendulum.yaml"


def test_a_typing_error_in_the_runs_leaves_an_accepted_fit_as_it_is(
    swings, pendulum
) -> None:
    runs, out = swings[0], pendulum.parent / "out"
    fit([runs], pendulum, out)
    stated = pendulum.read_text()
    accept(out, pendulum)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with refusal("runz: no such folder"):
        fit([runs.with_name("runz")], pendulum, out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    undo(out, pendulum)
    assert pendulum.read_text() == stated


def test_the_folder_of_a_run_takes_no_results(swings, pendulum) -> None:
    runs = swings[0]
    out = next(runs.iterdir())
    (out / "report.html").write_text(NOTE)
    with refusal(r"no fit\.json"):
        fit([runs], pendulum, out)
    assert (out / "report.html").read_text() == NOTE
    (out / "report.html").unlink()


@pytest.mark.parametrize("name", ["pendulum.yaml", "model.xml"])
def test_a_file_that_is_edited_while_it_is_fitted_is_not_accepted_into(
    swings, pendulum, name: str
) -> None:
    out, edited = pendulum.parent / "out", pendulum.with_name(name)

    def edits(stage: str, _: float) -> None:
        if stage.startswith("read"):
            edited.write_text(edited.read_text() + "\n")

    verdict = fit([swings[0]], pendulum, out, progress=edits)
    assert verdict.next.kind == "repeat"
    assert str(edited) in verdict.next.words
    with refusal("nothing was named"):
        accept(out, pendulum)
    assert edited.read_text().endswith("\n\n")


def test_a_model_that_is_edited_after_the_fit_is_not_put_out_of_use(
    swings, pendulum
) -> None:
    out, model = pendulum.parent / "out", pendulum.with_name("model.xml")
    fit([swings[0]], pendulum, out)
    before = pendulum.read_text()
    model.write_text(model.read_text() + "<!-- weighed again -->\n")
    with pytest.raises(ConfigurationError) as caught:
        accept(out, pendulum)
    assert str(caught.value).startswith(f"{model}: has changed since it was fitted")
    assert pendulum.read_text() == before
