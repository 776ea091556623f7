"""The package works from a wheel, in an environment of its own, from any folder."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of a fresh environment that holds the wheel; its dependencies are
    ours.
    """
    folder = tmp_path_factory.mktemp("wheel")
    command = [
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "-t",
        "wheel",
        "-d",
        str(folder),
    ]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    home = folder / "env"
    venv.create(home, with_pip=False)
    python = home / "bin" / "python"
    install = f"-m pip --python {python} install --no-deps -q {wheel}".split()
    subprocess.run([sys.executable, *install], check=True, capture_output=True)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    ours = sysconfig.get_paths()["purelib"]
    (home / "lib" / version / "site-packages" / "ours.pth").write_text(ours + "\n")
    return home / "bin"


@pytest.mark.slow
def test_the_wheel_folds_from_another_folder(installed: Path, tmp_path: Path) -> None:
    facts = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    where = subprocess.run(
        [installed / "python", "-c", "import cell, policies; print(cell.__file__)"],
        cwd=tmp_path,
        env=facts,
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(where.stdout.strip()).is_relative_to(installed.parent)
    folded = subprocess.run(
        [installed / "cell", "fold", "--strip", "denim", "--json"],
        cwd=tmp_path,
        env=facts,
        capture_output=True,
        text=True,
        check=False,
    )
    assert folded.returncode == 0, folded.stderr
    line = json.loads(folded.stdout)
    assert line["outcome"] == "layer_touch"
    assert abs(line["displacement"]) < 0.018
    run = tmp_path / line["run"]
    for name in ("run.yaml", "ticks.parquet", "profile.parquet", "result.yaml"):
        assert (run / name).is_file(), name
    for drawn, file in (("report", "report.html"), ("viz", "run.rrd")):
        subprocess.run([installed / "cell", drawn, run], env=facts, check=True)
        assert (run / file).is_file()
