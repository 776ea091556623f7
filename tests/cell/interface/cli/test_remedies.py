"""What messages tell a person to type, set or read exists: commands, options, files."""

import ast
import re
from collections.abc import Iterator

import typer

from cell.interface.cli.app import app
from tests.support.rooms import ROOT

ROOMS = ("cell", "drivers", "calibration", "policies")
COMMAND = re.compile(r"`cell((?: [^`]*)?)`")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
PAGE = re.compile(r"\brunbooks/[\w-]+\.md")
KIND = re.compile(r"\b(strip|plant|mechanism|pendulum) file\b")
FOREIGN_COMMAND = re.compile(r"`(?!cell |--)[^`]*`")
# variables of CSS, options of Rerun's own command
FOREIGN = {"cell/report/drawing.py", "cell/report/viz/opening.py"}


def told() -> Iterator[tuple[str, str]]:
    """Each text of the product with its place, docstrings aside; `X` for a value."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            place = path.relative_to(ROOT).as_posix()
            yield from ((place, text) for text in _texts(ast.parse(path.read_text())))


def _texts(tree: ast.Module) -> Iterator[str]:
    parts: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr | ast.Expr):
            parts.update(ast.iter_child_nodes(node))
        if isinstance(node, ast.JoinedStr):
            yield "".join(
                str(part.value) if isinstance(part, ast.Constant) else "X"
                for part in node.values
            )
        elif isinstance(node, ast.Constant) and node not in parts:
            yield str(node.value)


MESSAGES = list(told())
ROOT_COMMAND = typer.main.get_command(app)


def inner(command) -> dict:
    """Commands of a group by name; none of any other command."""
    return getattr(command, "commands", {})


def named(words: list[str]):
    """Command that `words` name, with the words that follow it."""
    command = ROOT_COMMAND
    while words and words[0] in inner(command):
        command, words = inner(command)[words[0]], words[1:]
    return command, words


def options(command) -> set[str]:
    own = {name for p in command.params for name in (*p.opts, *p.secondary_opts)}
    return own | {"--help"}


def every_option(command) -> set[str]:
    return options(command).union(*map(every_option, inner(command).values()))


def test_every_command_that_a_message_names_exists_with_its_options() -> None:
    wrong = []
    for place, text in MESSAGES:
        for typed in COMMAND.findall(text):
            command, rest = named(typed.split())
            any_of = rest[:1] == ["X"]
            known = every_option(command) if any_of else options(command)
            unknown = set(OPTION.findall(typed)) - known
            names_none = inner(command) and not any_of and rest[:1] not in ([], ["..."])
            if unknown or names_none:
                wrong.append(f"{place}: cell{typed}")
    assert not wrong


def test_every_option_that_a_message_names_is_one_of_some_command() -> None:
    known = every_option(ROOT_COMMAND)
    wrong = [
        f"{place}: {option} in {text[:60]!r}"
        for place, text in MESSAGES
        for option in OPTION.findall(FOREIGN_COMMAND.sub("", text))
        if option not in known and place not in FOREIGN
    ]
    assert not wrong


def test_every_page_that_a_message_names_exists() -> None:
    names = {(place, name) for place, text in MESSAGES for name in PAGE.findall(text)}
    assert names
    assert not [each for each in names if not (ROOT / each[1]).is_file()]


def test_every_kind_of_file_that_a_message_asks_for_is_one_of_the_configuration() -> (
    None
):
    kinds = {(place, kind) for place, text in MESSAGES for kind in KIND.findall(text)}
    assert kinds
    assert not [each for each in kinds if not (ROOT / f"configs/{each[1]}s").is_dir()]
