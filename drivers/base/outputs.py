"""Files and folders that a person names for results: only what the program wrote itself
is written over.
"""

import hashlib
import os
import re
import struct
import zlib
from pathlib import Path

from drivers.base.errors import ConfigurationError
from drivers.base.files import encoded, write_file, writing

PNG, AFTER_HEADER = b"\x89PNG\r\n\x1a\n", 33  # bytes, of signature and first chunk
SEAL = re.compile(
    rb'<meta name="generator" content="folding cell (\w{16})">\n'
    rb"|\0\0\0\x26tEXtSoftware\0folding cell (\w{16}).{4}",
    re.DOTALL,
)
"""Seal in an HTML page or a PNG picture: a digest of all that stands beside it."""


def write_output(path: Path, content: str | bytes) -> None:
    """Write an HTML page or a PNG picture, sealed, to the `path` that a person named.

    Raises ConfigurationError where it cannot be written, and as `check_output`.
    """
    check_output(path)
    write_file(path, sealed(encoded(content)))


def check_output(path: Path) -> None:
    """Refuse to write over the file at `path` unless `write_output` wrote it as it is.

    To be asked before the work whose result goes there. Raises ConfigurationError for a
    file of someone else, or one that someone has changed; a missing one is good.
    """
    with writing(path):
        present = path.read_bytes() if path.is_file() else None
    if present is not None and not _is_sealed(present):
        raise ConfigurationError(
            f"{path}: was not written by this program, or was changed since; name"
            " another file, or move this one away"
        )


def check_output_folder(folder: Path, *marks: str) -> None:
    """Refuse to write results into `folder` unless it is new, empty or holds one of
    `marks`.

    Marks are names of what the command itself puts into each such folder, before or
    together with all else; a fit may follow a check in one folder. To be asked before
    anything is read, made or removed. Raises ConfigurationError for a folder with other
    content, and for what is no folder.
    """
    if not os.path.lexists(folder) or any((folder / mark).exists() for mark in marks):
        return
    with writing(f"--out: {folder}"):
        if not any(folder.iterdir()):
            return
    raise ConfigurationError(
        f"--out: {folder} holds files but no {' or '.join(marks)}, so they are not of"
        " this command; name a new folder"
    )


def sealed(content: bytes) -> bytes:
    """Copy of an HTML page or a PNG picture with a seal by which it is known again."""
    digest = _digest(content)
    if content.startswith(PNG):
        text = b"tEXtSoftware\0folding cell " + digest
        chunk = struct.pack(">I", len(text) - 4) + text
        return _insert(
            content, AFTER_HEADER, chunk + struct.pack(">I", zlib.crc32(text))
        )
    line = b'<meta name="generator" content="folding cell %s">\n' % digest
    return _insert(content, content.index(b"<head>\n") + len(b"<head>\n"), line)


def _is_sealed(content: bytes) -> bool:
    """Whether `content` bears a seal and nothing in it has changed since."""
    seal = SEAL.search(content)
    if seal is None:
        return False
    unsealed = content[: seal.start()] + content[seal.end() :]
    return _digest(unsealed) == (seal[1] or seal[2])


def _insert(content: bytes, index: int, part: bytes) -> bytes:
    return content[:index] + part + content[index:]


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest()[:16].encode()
