"""Reading of input files: regular files only, of bounded size, refused in one line."""

import os
import stat
from pathlib import Path

from drivers.errors import ConfigurationError

MEGABYTE = 1_000_000
TEXT = 200_000  # bytes of a file that a person writes, with much room
KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def read_bytes(path: Path, most: int) -> bytes:
    """Content of the regular file at `path`, at most `most` bytes.

    Raises ConfigurationError for a file that is missing, too large, unreadable or not regular. A
    pipe or a device is never opened, because reading it could block for ever.
    """
    try:
        _check_kind(path, path.stat())
        with open(path, "rb", opener=_without_waiting) as file:
            _check_kind(path, os.fstat(file.fileno()))
            content = file.read(most + 1)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"{str(path)!r}: cannot be read: {error}") from None
    if len(content) > most:
        raise ConfigurationError(
            f"{path}: is larger than {most / MEGABYTE:g} MB, the most that is read; "
            "is it the right file?"
        )
    return content


def read_text(path: Path, most: int = TEXT) -> str:
    """Content of a file as UTF-8 text; as `read_bytes`, and refuses any other encoding."""
    try:
        return read_bytes(path, most).decode("utf-8")
    except UnicodeDecodeError:
        raise ConfigurationError(f"{path}: is not UTF-8 text; save it as UTF-8") from None


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)


def _check_kind(path: Path, found: os.stat_result) -> None:
    kind = stat.S_IFMT(found.st_mode)
    if kind in KINDS:
        raise ConfigurationError(
            f"{path}: cannot be read: is {KINDS[kind]}, must be a regular file"
        )
