"""Help, version, and what a shell completes."""

import re

import pytest
from typer.main import get_command

from cell.interface.cli.app import app
from policies.registry import policy_names as known_policies


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


@pytest.mark.parametrize("width", [50, 80, 200])
def test_help_shows_each_command_with_its_whole_sentence(width, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    text = " ".join(run(capsys, "--help").split())
    for command in get_command(app).commands.values():
        assert " ".join(command.get_short_help_str(1000).split()) in text


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
def test_a_shell_completes_commands_names_and_choices(
    typed, offered, monkeypatch, capsys
) -> None:
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
