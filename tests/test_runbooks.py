"""Commands in README and runbooks are commands that there are; the cheap ones run as written."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
import typer

from cell.__main__ import main
from cell.cli.app import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "runbooks").rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(cell [^`\n]+)`")
RUN = [
    "cell --help",
    "cell strips",
    "cell strips new linen --length 0.6 --width 0.05 --areal-density 0.2",
    "cell gap plan --strip denim --dry-run",
    "cell runs --runs runs/trial",
    "cell study",
]  # also on the pages, and quick: they run as they stand there


def fenced(text: str) -> list[str]:
    """Commands of `cell` in the blocks of shell on a page, one a line."""
    found = []
    for kind, block in FENCE.findall(text):
        if kind in {"sh", "console", "bash"}:
            joined = block.replace("\\\n", " ")
            lines = [line.strip().removeprefix("$ ") for line in joined.splitlines()]
            found += [line for line in lines if re.match(r"(\.venv/bin/)?cell\b", line)]
    return found


def parsed(line: str) -> None:
    """Parse a command line without running it; ValueError for what there is not."""
    words = [w for w in shlex.split(line, comments=True)[1:] if w not in {"...", "&"}]
    command = typer.main.get_command(app)
    while words and not words[0].startswith("-") and hasattr(command, "commands"):
        if words[0] not in command.commands:
            raise ValueError(f"there is no command {words[0]}")
        command, words = command.commands[words[0]], words[1:]
    known = {name for each in command.params for name in (*each.opts, *each.secondary_opts)}
    for word in words:
        option = word.partition("=")[0]
        if option.startswith("--") and option not in {*known, "--help"}:
            raise ValueError(f"there is no option {option}")


COMMANDS = sorted({(page.name, line) for page in PAGES for line in fenced(page.read_text("utf-8"))})
SAID = sorted({(page.name, line) for page in PAGES for line in INLINE.findall(page.read_text())})


def test_there_are_commands_to_look_at() -> None:
    assert len(COMMANDS) > 30
    assert len(SAID) > 50


@pytest.mark.parametrize("said", ["cell fodl", "cell fold --stripe denim", "cell gap fot x"])
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


@pytest.mark.parametrize("line", RUN)
def test_a_cheap_command_runs_as_it_stands(line, tmp_path, monkeypatch, capsys) -> None:
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    (tmp_path / "runs" / "trial").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", shlex.split(line))
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code in (0, None), capsys.readouterr().err
