"""Errors of input: one clear line, the right exit code, nothing half-written."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cell.base.config.places import CHECKOUT_CONFIGS
from tests.support.commands import refused


@pytest.fixture
def configs(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CHECKOUT_CONFIGS, tmp_path / "configs"))


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
    content = "\n".join(
        line for line in path.read_text().splitlines() if not line.startswith("effects")
    )
    text = content + "\neffects: {}\n"
    assert change[0] in text
    path.write_text(text.replace(*change))
    line = refused(
        monkeypatch,
        capsys,
        *("fold --strip denim --configs", configs, "--runs", tmp_path / "r"),
    )
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
SOLVERS = {"scipy.spatial", "scipy.integrate", "scipy.optimize", "torch", "matplotlib"}
RUN = """
from cell.__main__ import main
try:
    main()
except SystemExit as end:
    code = end.code
"""


@pytest.mark.parametrize(
    ("words", "script", "code", "heavy"),
    [
        ("--help", RUN, 0, HEAVY | {"cv2", "pyarrow", "numpy"}),
        (
            "fold --strip denim --runs /proc/nope",
            RUN,
            2,
            HEAVY | {"cv2", "pyarrow", "numpy"},
        ),
        ("fold --strip demin", RUN, 2, HEAVY | {"cv2", "pyarrow", "numpy"}),
        ("gap fit runs --strip demin --out out", RUN, 2, HEAVY | {"cv2", "numpy"}),
        ("home --strip demin", RUN, 2, HEAVY | {"cv2", "numpy"}),
        ("fold --strip denim --until 3mx", RUN, 2, HEAVY | {"cv2", "pyarrow", "numpy"}),
        (
            "fold --strip denim --until 3mm --rehearse",
            RUN,
            2,
            HEAVY | {"cv2", "pyarrow", "numpy"},
        ),
        (
            "fold --strip denim --until 3mm --learning off",
            RUN,
            2,
            HEAVY | {"cv2", "numpy"},
        ),
        (
            "fold --strip denim --plant gone.yaml",
            RUN,
            2,
            HEAVY | {"cv2", "pyarrow", "numpy"},
        ),
        (
            "gap plan --strip denim --runs /proc/nope",
            RUN,
            2,
            HEAVY | {"cv2", "pyarrow", "numpy"},
        ),
        ("fold --strip denim --learning nope", RUN, 2, HEAVY),
        ("fold --strip denim --camera v4l2", RUN, 2, HEAVY),
        (
            "",
            "import cell.folding.batch, cell.base.devices.twin\ncode = None",
            None,
            SOLVERS,
        ),
        (
            "",
            "import cell.record.listing\ncode = None",
            None,
            HEAVY | {"cv2", "pyarrow", "numpy"},
        ),
    ],
)
def test_what_is_refused_at_once_and_what_folds_import_nothing_heavy(
    words, script, code, heavy
) -> None:
    script = f"import sys\nsys.argv = ['cell', *{words.split()}]\n{script}\n"
    script += f"print('\\nleft:', code, sorted({heavy} & set(sys.modules)))\n"
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert told.stdout.splitlines()[-1] == f"left: {code} []"


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
