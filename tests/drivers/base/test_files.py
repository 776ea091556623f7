"""The door by which files come in: what is not a file of ordinary size is refused at
once.
"""

import os
import socket
from pathlib import Path

import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_bytes, read_yaml
from drivers.base.settings import Settings, load

BOMB = "a: &a [x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]\n"
    for i in range(24)
)
BOUNDED = {
    "aliases of aliases": (BOMB, "line 12: holds more than 10000 values"),
    "an alias within what it names": ("a: &a [*a]", "stands within what it names"),
    "lists in lists": ("a: " + "[" * 100_000, "nested more than 32 deep"),
    "mappings in mappings": ("a: " + "{a: " * 1000, "nested more than 32 deep"),
    "values without end": (
        "a: [" + "1, " * 20_000 + "1]",
        "holds more than 10000 values",
    ),
    "a number to the base 60": ("a: " + "1:" * 60_000 + "1", "digits, at most 64"),
    "a hexadecimal number": ("a: 0x" + "f" * 9000, "digits, at most 64"),
    "a date that is none": ("a: !!timestamp x", "not what its !! tag says"),
    "an empty number": ('a: !!int ""', "not what its !! tag says"),
    "a truth value that is none": ("a: !!bool x", "not what its !! tag says"),
    "a date for a key": ("2001-01-01: 1", "a key must be a word"),
    "an object": (
        "a: !!python/object/apply:os.getcwd []",
        "could not determine a constructor",
    ),
    "megabytes": ("# " + "x" * 300_000, "larger than 0.2 MB"),
}


@pytest.mark.parametrize("name", BOUNDED)
def test_yaml_that_would_hang_is_refused_at_its_line(tmp_path, name) -> None:
    text, says = BOUNDED[name]
    path = tmp_path / "strip.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=says) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (_pipe, "is a pipe, must be a regular file"),
        (_socket, "is a socket, must be a regular file"),
        (
            lambda path: path.symlink_to("/dev/zero"),
            "is a device, must be a regular file",
        ),
        (lambda path: path.symlink_to(path), "cannot be read"),
        (Path.mkdir, "Is a directory"),
        (lambda path: None, "No such file"),
        (lambda path: path.write_bytes(b"x" * 101), "thin or cut it"),
    ],
)
def test_what_is_no_file_of_ordinary_size_is_never_waited_for(
    tmp_path, monkeypatch, make, says
) -> None:
    monkeypatch.chdir(tmp_path)  # the name of a socket must be short
    path = Path("it")
    make(path)
    with pytest.raises(ConfigurationError, match=says):
        read_bytes(path, 100)


class Dated(Settings):
    schema_: int = 1


def test_a_file_without_its_schema_is_refused(tmp_path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("{}")
    with pytest.raises(ConfigurationError, match="schema: is missing; add it"):
        load(path, Dated)
