"""Help, version, and the commands that README and runbooks tell people to type."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from cell.cli.app import app
from policies.registry import policy_names as known_policies

ROOT = Path(__file__).parents[3]
PAGES = [ROOT / "README.md", *sorted((ROOT / "runbooks").glob("*.md"))]
PLACES = {"RUN...": "runs/a", "FILE": "f.yaml", "DIR": "d", "N": "1", "RUN": "runs/a"}


def run(capsys, *words: str) -> str:
    with pytest.raises(SystemExit) as end:
        app(list(words))
    assert end.value.code == 0
    return capsys.readouterr().out


def test_version_is_printed(capsys) -> None:
    assert re.fullmatch(r"cell \d+\.\d+\.\d+\S*\n", run(capsys, "--version"))


def test_help_names_every_choice(capsys) -> None:
    text = " ".join(run(capsys, "fold", "--help").split())
    for choice in (*known_policies(), "<twin|fci>", "<twin|v4l2>", "<all|key|none>"):
        assert choice in text
    assert "<save|live|off>" in text


def typed() -> list[str]:
    """Every `cell ...` that a page tells to type, in a block of its own."""
    found = []
    for page in PAGES:
        blocks = re.findall(r"```(?:sh|console)\n(.*?)```", page.read_text("utf-8"), flags=re.S)
        lines = [line.removeprefix("$ ").strip() for block in blocks for line in block.splitlines()]
        found += [line for line in lines if line.startswith("cell ")]
    return sorted(set(found))


def named() -> list[str]:
    """Every `cell ...` that a page names within a sentence."""
    found = []
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.S)
        found += re.findall(r"`(cell [a-z][^`]*)`", text)
    return sorted(set(found))


def resolved(line: str) -> tuple[Any, Any, list[str]]:
    """The command that a line names, its parent's context, and the words after it."""
    words = [PLACES.get(word, word) for word in shlex.split(line, comments=True)[1:]]
    command: Any = typer.main.get_command(app)
    context = command.make_context("cell", [], resilient_parsing=True)
    while hasattr(command, "get_command") and words and not words[0].startswith("-"):
        name = words.pop(0)
        command = command.get_command(context, name)
        assert command is not None, f"{name} is no command"
        if words:
            context = command.make_context(name, [], parent=context, resilient_parsing=True)
    return command, context, words


@pytest.mark.parametrize("line", typed())
def test_commands_in_readme_and_runbooks_can_be_typed(line: str) -> None:
    command, context, words = resolved(line)
    assert command.make_context(command.name, words, parent=context).args == []


@pytest.mark.parametrize("line", named())
def test_commands_that_readme_and_runbooks_name_exist(line: str) -> None:
    command, _, words = resolved(line)
    known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
    assert {word for word in words if word.startswith("--")} <= known


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("cell fo", {"fold"}),
        ("cell fold --strip de", {"denim"}),
        ("cell fold --policy ad", {"adaptive"}),
        ("cell gap plan --strip swim", {"swimwear"}),
        ("cell fold --fil", {"--film"}),
        ("cell fold --film lib", {"libx264"}),
    ],
)
def test_a_shell_completes_commands_names_and_choices(typed, offered, monkeypatch, capsys) -> None:
    monkeypatch.setenv("_CELL_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split()) - 1))
    with pytest.raises(SystemExit):
        app([], prog_name="cell")
    assert set(capsys.readouterr().out.split()) == offered


def test_completion_can_be_installed(capsys, monkeypatch) -> None:
    monkeypatch.setattr("shellingham.detect_shell", lambda: ("bash", "/bin/bash"))
    with pytest.raises(SystemExit):
        app(["--show-completion", "bash"], prog_name="cell")
    assert "_CELL_COMPLETE=complete_bash" in capsys.readouterr().out
