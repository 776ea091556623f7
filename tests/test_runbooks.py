"""Commands in README and runbooks are commands that there are; the cheap ones run as
written.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
import typer

from cell.__main__ import main
from cell.interface.cli.app import app
from drivers.base.readers import read_yaml
from tests.lab.__main__ import app as lab
from tests.support.fci_clients import served
from tests.support.run_edits import edit_yaml

ROOT = Path(__file__).parents[1]
NOTES = ROOT / "tests" / "lab" / "notes"
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "runbooks").rglob("*.md")),
    *NOTES.glob("*.md"),
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LAB = "python -m tests.lab"
commands_of = cache(typer.main.get_command)
INLINE = re.compile(rf"`((?:cell|{LAB}) [^`\n]+)`")
RUN = [
    "cell --help",
    "cell strips",
    "cell strips new linen --length 0.6 --width 0.05 --areal-density 0.2",
    "cell gap plan --strip denim --dry-run",
    "cell runs --runs runs/trial",
    "python -m tests.lab study",
]  # also on the pages, and quick: they run as they stand there
LENS, TOUCHES = "calibrations/*-camera", "calibrations/*-homography"
# longer: they run in this order in one folder, with a session's folder or fewer cases
PLAYED = {
    "cell fold --strip denim --runs runs/trial": {},
    "cell export runs/trial --format csv --out tables": {},
    "cell fold --strip denim --plant denim --policy planned --seed 21": {},
    "cell fold --strip denim --policy planned --dry-run": {},
    "cell strips new felt --length 0.6 --width 0.05 --areal-density 0.31": {},
    "cell calibrate camera --measured 252.0mm": {},
    "cell calibrate camera --resume DIR": {"DIR": LENS},
    "cell calibrate camera --from DIR --without 7 --out NEW": {"DIR": LENS},
    "cell calibrate homography --use": {},
    "cell calibrate homography --lens lens.yaml": {
        "lens.yaml": f"{LENS}/camera_info.yaml"
    },
    "cell calibrate homography --poses DIR/poses.yaml": {"DIR": TOUCHES},
    "cell calibrate homography --from DIR --without 6 --out NEW": {
        "DIR": TOUCHES,
        "NEW": "again",
    },
    "cell calibrate check": {},
    "python -m tests.lab study unknown --count 60 --jobs 2": {"60": "1"},
    "python -m tests.lab study unknown --count 60 --show": {"60": "1"},
}
# of the first day, on an emulated robot
WALKED = ("1", "3", "7", "8", "11")
ELSEWHERE = read_yaml(Path(__file__).with_name("runbooks.yaml"))


def fenced(text: str) -> list[str]:
    """Commands of `cell` and the laboratory in the blocks of shell on a page, one a
    line.
    """
    found = []
    for kind, block in FENCE.findall(text):
        if kind in {"sh", "console", "bash"}:
            joined = block.replace("\\\n", " ")
            lines = [line.strip().removeprefix("$ ") for line in joined.splitlines()]
            found += [
                line for line in lines if re.match(rf"(\.venv/bin/)?cell\b|{LAB}", line)
            ]
    return found


def parsed(line: str) -> None:
    """Parse a command line without running it; ValueError for what there is not."""
    rest = line.removeprefix(LAB if line.startswith(LAB) else line.split()[0])
    words = [w for w in shlex.split(rest, comments=True) if w not in {"...", "&"}]
    command = commands_of(lab if line.startswith(LAB) else app)
    while words and not words[0].startswith("-") and hasattr(command, "commands"):
        if words[0] not in command.commands:
            raise ValueError(f"there is no command {words[0]}")
        command, words = command.commands[words[0]], words[1:]
    if command.context_settings.get("ignore_unknown_options"):
        return
    known = {
        name for each in command.params for name in (*each.opts, *each.secondary_opts)
    }
    for word in words:
        option = word.partition("=")[0]
        if option.startswith("--") and option not in {*known, "--help"}:
            raise ValueError(f"there is no option {option}")


COMMANDS = sorted(
    {(page.name, line) for page in PAGES for line in fenced(page.read_text("utf-8"))}
)
SAID = sorted(
    {(page.name, line) for page in PAGES for line in INLINE.findall(page.read_text())}
)


def test_there_are_commands_to_look_at() -> None:
    assert len(COMMANDS) > 30
    assert len(SAID) > 50


@pytest.mark.parametrize(
    "said", ["cell fodl", "cell fold --stripe denim", "cell gap fot x"]
)
def test_a_command_that_does_not_exist_is_noticed(said: str) -> None:
    with pytest.raises(ValueError, match="there is no"):
        parsed(said)


def test_every_command_on_the_pages_exists_with_its_options() -> None:
    wrong = []
    for page, line in [*COMMANDS, *SAID]:
        try:
            parsed(line.split("&&")[-1].split(" | ")[0].split(" > ")[0].strip())
        except ValueError as error:
            wrong.append(f"{page}: {line}: {error}")
    assert not wrong


def test_every_command_on_the_pages_is_run_by_some_test() -> None:
    lines = {shlex.join(shlex.split(line, comments=True)) for _, line in COMMANDS}
    lines = {line.split(" && ")[-1].replace("'", "") for line in lines}
    here = {*RUN, *PLAYED}
    assert not sorted(
        line
        for line in lines
        if line not in here and not line.startswith(tuple(ELSEWHERE))
    )
    assert set(PLAYED) <= lines
    assert all((ROOT / place).exists() for place in ELSEWHERE.values())


def play(line: str, folder: Path) -> None:
    """Run a command line in `folder` as a person would, who sees it end well."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    played = subprocess.run(
        ["sh", "-c", line],
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert played.returncode == 0, f"{line}\n{played.stderr}"


@pytest.mark.slow
def test_longer_commands_run_one_after_the_other_in_one_folder(tmp_path) -> None:
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    for line, places in PLAYED.items():
        for word, place in places.items():
            found = sorted(tmp_path.glob(place))[0] if "*" in place else place
            line = re.sub(rf"\b{re.escape(word)}\b", str(found), line)  # noqa: PLW2901
        play(line, tmp_path)


@pytest.mark.slow
def test_first_day_leads_an_emulated_robot_to_a_fold(tmp_path) -> None:
    pytest.importorskip("pylibfranka", reason="the robot's library is not installed")
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    page = (ROOT / "runbooks" / "first-day-with-a-real-arm.md").read_text("utf-8")
    rows = dict(re.findall(r"^\| (\d+) \| \d+ \| (.*?) \|", page, re.MULTILINE))
    with served("--between", "0.9mm") as (told, _):
        edit_yaml(
            tmp_path / "configs/cell.yaml",
            drivers={"arm": "fci", "camera": "twin"},
            fci={"address": told["address"], "lock_step": True},
        )
        for number in WALKED:
            for line in INLINE.findall(rows[number]):
                play(line, tmp_path)


@pytest.mark.parametrize("line", RUN)
def test_a_cheap_command_runs_as_it_stands(line, tmp_path, monkeypatch, capsys) -> None:
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    (tmp_path / "runs" / "trial").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "sys.argv", ["cell", *shlex.split(line.removeprefix(LAB).removeprefix("cell"))]
    )
    with pytest.raises(SystemExit) as end:
        main(lab if line.startswith(LAB) else app)
    assert end.value.code in (0, None), capsys.readouterr().err
