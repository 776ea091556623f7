"""Errors of input: one clear line, the right exit code, nothing half-written."""

import subprocess
import sys

import pytest

from tests.support.commands import refused
from tests.support.run_edits import edit_yaml


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("length: 0.6", "length: [0.6"), "not valid YAML"),
        (("length: 0.6", "length: -1.0"), "length"),
        (("length: 0.6", "thickness: thin\nlength: 0.6"), "given twice"),
        (("effects: {}", "effects: {wind: {speed: 1.0}}"), "wind"),
        (("effects: {}", "effects: {camera_latency: {time: 0.01}}"), "camera_latency"),
        (("schema: 1", "schema: 9"), "schema"),
    ],
)
def test_broken_strip_file_names_file_and_key(
    monkeypatch, capsys, configs, tmp_path, change, said
) -> None:
    path = configs / "strips" / "denim.yaml"
    edit_yaml(path, effects={})
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change))
    words = ("fold --strip denim --configs", configs, "--runs", tmp_path / "r")
    line = refused(monkeypatch, capsys, *words)
    assert all(problem.startswith(str(path)) for problem in line.splitlines()), line
    assert said in line
    assert not (tmp_path / "r").exists()


def test_missing_calibration_is_refused(monkeypatch, capsys, configs, tmp_path) -> None:
    cell = configs / "cell.yaml"
    cell.write_text(cell.read_text() + f"calibration: {tmp_path / 'gone.yaml'}\n")
    words = ("fold --strip denim --configs", configs, "--runs", tmp_path / "r")
    line = refused(monkeypatch, capsys, *words)
    assert "gone.yaml: there is no" in line
    # which replaces the name in cell.yaml
    assert "cell calibrate homography --use" in line
    assert not (tmp_path / "r").exists()


HEAVY = {"mujoco", "torch", "numba", "rerun", "matplotlib"}
LIGHT = HEAVY | {"cv2", "numpy"}
BARE = LIGHT | {"pyarrow"}
SOLVERS = {
    *("scipy.spatial", "scipy.integrate", "scipy.optimize", "scipy.interpolate"),
    *("torch", "matplotlib", "rerun", "jinja2"),
}


def left_of(code: str, modules: set[str]) -> str:
    """Last line that a process prints that ran `code`, and those `modules` in it."""
    script = f"import sys\n{code}\nprint('\\n', sorted({modules} & set(sys.modules)))\n"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "absent"),
    [
        ("fold --help", HEAVY),
        ("--help", BARE),
        ("fold --strip denim --runs /proc/nope", BARE),
        ("fold --strip demin", BARE),
        ("gap fit runs --strip demin --out out", LIGHT),
        ("home --strip demin", LIGHT),
        ("fold --strip denim --until 3mx", BARE),
        ("fold --strip denim --until 3mm --rehearse", BARE),
        ("fold --strip denim --until 3mm --learning off", LIGHT),
        ("fold --strip denim --plant gone.yaml", BARE),
        ("gap plan --strip denim --runs /proc/nope", BARE),
        ("fold --strip denim --learning nope", HEAVY),
        ("fold --strip denim --camera v4l2", HEAVY),
    ],
)
def test_what_is_refused_at_once_imports_nothing_heavy(words, absent) -> None:
    run = f"sys.argv = ['cell', *{words.split()}]\nfrom cell.__main__ import main\n"
    run += "try:\n    main()\nexcept SystemExit as end:\n    code = end.code"
    asked = 0 if words.endswith("--help") else 2
    assert left_of(f"{run}\nassert code == {asked}", absent) == " []"


@pytest.mark.parametrize(
    ("modules", "absent"),
    [
        ("cell.folding.batch, cell.base.devices.twin", SOLVERS),
        ("cell.record.listing", BARE),
    ],
)
def test_what_folds_and_what_lists_runs_import_nothing_heavy(modules, absent) -> None:
    assert left_of(f"import {modules}", absent) == " []"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("fold --strip silk", "silk: is neither a strip"),
        ("fold --strip demin", "did you mean 'denim'?"),
        (
            "fold --strip denim --policy feedbak",
            "did you mean 'feedback'?",
        ),
        ("gap plan --strip demin", "did you mean 'denim'?"),
        (
            "gap fit runs --strip demin --out out",
            "did you mean 'denim'?",
        ),
        ("home --strip demin", "did you mean 'denim'?"),
        ("jog", "--x, --z, --pitch: give one at least"),
        ("jog --zz 1", "no such option: --zz"),
        (
            "jog --arm fcii",
            "invalid value for '--arm': 'fcii' is not one of 'twin', 'fci'",
        ),
        ("note", "missing argument 'RUN'; `cell note --help` lists what goes"),
        (
            "runs one two",
            "got unexpected extra argument(s) (one two); `cell runs --help`",
        ),
        ("runs place", "lists what goes; a folder of runs goes after `--runs`"),
        ("gap fti", "no such command 'fti'"),
        (
            "calibrate camera --resume file",
            "--resume: file holds no session",
        ),
        (
            "calibrate --out file camera",
            "cell calibrate: give options after `camera`",
        ),
        ("report gone", "gone: is not there; see `cell runs`, or give its path"),
        (
            "report runs",
            "runs: is not a run: it holds no run.yaml; name one of those in it",
        ),
        ("note file --tag good", "file: is a file, a run is a folder"),
        ("report runs/one/run.yaml", "is a folder; give the folder, runs/one"),
        (
            "gap fit file --strip denim --out out",
            "file: is a file; give run",
        ),
        (
            "report file",
            "file: is neither a run's folder nor a calibration's YAML file",
        ),
        ("note runs/one", "--tag, --untag, --text: give one at least"),
        (
            "runs --runs runs/one",
            "runs/one: is a run; name the folder that it lies in",
        ),
        ("train --out runs", "--out: runs holds files but no feedback.jsonl"),
        ("benchmark --out runs", "--out: runs holds files but no parts"),
        (
            "gap rehearse runs --strip denim --out runs",
            "--out: runs holds files but no journal",
        ),
        ("import runs --out out", "runs/one: is a run already"),
        ("import runs/one --out out", "runs/one: is a run already"),
        (
            "import file --out out",
            "file: is none of what is read; give tables",
        ),
        (
            "gap accept file --strip denim",
            "file: is a file; name the folder that",
        ),
        (
            "gap advise runs",
            "runs/fit.json: is missing; name the folder that",
        ),
        ("runs --delete", "--keep, --older-than: give one"),
        ("runs --keep 1 --delete --html page", "go without --html"),
    ],
)
def test_words_that_lead_nowhere_are_refused_and_nothing_is_made(
    monkeypatch, capsys, tmp_path, words, said
) -> None:
    (tmp_path / "runs" / "one").mkdir(parents=True)
    (tmp_path / "runs" / "one" / "run.yaml").write_text("schema: 1\n")
    (tmp_path / "file").write_text("")
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    line = refused(monkeypatch, capsys, words)
    assert said in line
    assert "\n" not in line
    assert sorted(tmp_path.rglob("*")) == before


def test_packaged_configuration_is_not_changed_and_no_arm_moves_for_it(
    monkeypatch, capsys, configs
) -> None:
    monkeypatch.setattr("cell.interface.cli.options.PACKAGED", configs)
    monkeypatch.setattr(
        "cell.interface.cli.calibrate._open_devices",
        lambda *_: pytest.fail("a device was opened"),
    )
    words = ("calibrate homography --use --configs", configs)
    assert refused(monkeypatch, capsys, *words).startswith(
        f"--configs: {configs} belongs"
    )
