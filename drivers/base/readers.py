"""Readers of files from outside: regular files only, of bounded size, depth and digits.

Libraries are imported where they are used, for commands that do not need them.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.base.errors import ConfigurationError
from drivers.base.yaml_text import parse_yaml

if TYPE_CHECKING:
    import pyarrow as pa

    from drivers.base.types import Image

SCHEMA = 1  # newest version of the cell's files that this program reads
MEGABYTE = 1_000_000
LARGEST_TEXT = 200_000  # bytes, a generous bound on a file that a person writes
LARGEST_PICTURE = 64 * MEGABYTE
LARGEST_LINES = 32 * MEGABYTE  # of JSON lines; a fold of two minutes writes half of one
# a fold's profile is below one
LARGEST_TABLE, LARGEST_UNPACKED = 64 * MEGABYTE, 256 * MEGABYTE
MOST_ROWS = 1_000_000  # of a table
MOST_LINES = 200_000
LINE_DEPTH = 16  # of nested lists and mappings in a line of JSON
LINE_DIGITS = 18  # of a whole number that fits 64 bits
LARGEST_SIDE = 16_384  # px, of any camera or phone; a few bytes can declare gigabytes
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
SPECIAL_FILES = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def read_bytes(path: Path, most: int) -> bytes:
    """Content of the regular file at `path`, at most `most` bytes.

    Raises ConfigurationError for a file that is missing, too large, unreadable or not
    regular. A pipe or a device is never opened, because reading it could block for
    ever.
    """
    with _regular_file(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ConfigurationError(
            f"{path}: is larger than {most / MEGABYTE:g} MB, the most that is read; "
            "thin or cut it, if it is the right file"
        )
    return content


def file_digest(path: Path) -> str:
    """SHA-256 of the regular file at `path`, of any size; ConfigurationError as
    `read_bytes`.
    """
    with _regular_file(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def _regular_file(path: Path) -> Iterator[BufferedReader]:
    """Context with the regular file at `path`, opened to be read in binary."""
    try:
        _check_regular(path, path.stat())
        with open(path, "rb", opener=_open_nonblocking) as file:
            _check_regular(path, os.fstat(file.fileno()))
            yield file
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"{str(path)!r}: cannot be read: {error}") from None


def read_text(path: Path, most: int = LARGEST_TEXT, fallback: str = "utf-8") -> str:
    """Content of the file at `path` as text in UTF-8, or in the `fallback` encoding if
    it is none.

    Raises ConfigurationError where it cannot be read.
    """
    content = read_bytes(path, most)
    for encoding in ("utf-8", fallback):
        with suppress(UnicodeDecodeError):
            return content.decode(encoding)
    raise ConfigurationError(f"{path}: is not UTF-8 text; save it as UTF-8")


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in the YAML file at `path`; ConfigurationError where it is missing or
    broken.
    """
    return parse_yaml(read_text(path), str(path))


def read_json(path: Path, most: int = LARGEST_TEXT) -> dict[str, Any]:
    """Mapping in the JSON file at `path`, of at most `most` bytes; ConfigurationError
    otherwise.
    """
    text = read_text(path, most)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: is not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise ConfigurationError(f"{path}: must be a mapping of keys to values")
    return content


def read_json_lines(path: Path, most: int = LARGEST_LINES) -> list[dict[str, Any]]:
    """Mappings in a JSON-lines file of at most `most` bytes, one per line; empty
    without a file.

    Lines that hold no mapping, such as a truncated last one, are skipped. Raises
    ConfigurationError for a file that is not regular, or too large.
    """
    if not path.exists():
        return []
    lines: list[dict[str, Any]] = []
    for line in read_bytes(path, most).split(b"\n", MOST_LINES)[:MOST_LINES]:
        try:
            content = json.loads(line, parse_int=_integer)
        except (ValueError, RecursionError):
            continue
        # as all lines of a run are
        shallow = line.count(b"{") + line.count(b"[") <= LINE_DEPTH
        if isinstance(content, dict) and (shallow or _is_flat(content, LINE_DEPTH)):
            lines.append(content)
    return lines


def read_parquet(path: Path) -> "pa.Table":
    """Parquet table at `path`; ConfigurationError where missing, broken or of a newer
    schema.
    """
    import pyarrow as pa

    if not path.exists():
        raise ConfigurationError(f"{path}: is missing; add it")
    content = read_bytes(path, LARGEST_TABLE)
    try:
        table = _parquet_table(content)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(
            f"{path}: is not a whole Parquet file: {reason}; write it again"
        ) from None
    schema = (table.schema.metadata or {}).get(b"schema", b"1")
    if not (schema.isdigit() and len(schema) < 9 and 0 < int(schema) <= SCHEMA):
        raise ConfigurationError(
            f"{path}: schema: is {schema.decode(errors='replace')}, this version reads"
            f" {SCHEMA}; update the cell"
        )
    return table


def read_picture(path: Path, side: int = LARGEST_SIDE) -> "Image":
    """PNG or JPEG picture (height, width, 3) at `path` in BGR, no side longer than
    `side` [px].

    Raises ConfigurationError for a file that is missing, not regular, broken or larger;
    nothing is decoded before the sides are known.
    """
    return picture_of(read_bytes(path, LARGEST_PICTURE), str(path), side)


def picture_of(content: bytes, origin: str, side: int = LARGEST_SIDE) -> "Image":
    """Picture (height, width, 3) in BGR in the `content` of a file.

    Raises ConfigurationError, with its `origin`, as `read_picture`.
    """
    width, height = picture_sides(content)
    if max(width, height) > side:
        raise ConfigurationError(
            f"{origin}: is {width} x {height} px, at most {side} px are read; make it"
            " smaller"
        )
    image = _decode(content) if min(width, height) > 0 else None
    if image is None:
        raise ConfigurationError(
            f"{origin}: is not a picture that can be read; give a JPEG or PNG"
        )
    return image


def picture_sides(content: bytes) -> tuple[int, int]:
    """Width and height [px] that the header of a PNG or JPEG declares; zeros for other
    content.

    Zeros too for a PNG whose chunks are broken: OpenCV would allocate what they
    declare.
    """
    from PIL import JpegImagePlugin, PngImagePlugin

    is_png = content.startswith(PNG_SIGNATURE)
    reader: Any = (
        PngImagePlugin.PngImageFile if is_png else JpegImagePlugin.JpegImageFile
    )
    try:
        # not Image.open, which has a bound of its own
        with reader(BytesIO(content)) as picture:
            width, height = picture.size
            if max(width, height) <= LARGEST_SIDE:
                picture.verify()
    except (OSError, SyntaxError, ValueError):
        return 0, 0
    return width, height


def _open_nonblocking(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)


def _check_regular(path: Path, status: os.stat_result) -> None:
    """Raise ConfigurationError where `path`, of this `status`, is a device, pipe or
    socket.
    """
    kind = stat.S_IFMT(status.st_mode)
    if kind in SPECIAL_FILES:
        raise ConfigurationError(
            f"{path}: cannot be read: is {SPECIAL_FILES[kind]}, must be a regular file"
        )


def _is_flat(value: object, depth: int) -> bool:
    """Whether lists and mappings are nested at most `depth` deep."""
    if isinstance(value, dict):
        value = list(value.values())
    if not isinstance(value, list):
        return True
    return depth > 0 and all(_is_flat(item, depth - 1) for item in value)


def _integer(text: str) -> int | float:
    """Number in `text`, an integer of JSON; a float where it has more than LINE_DIGITS
    digits.
    """
    return int(text) if len(text) <= LINE_DIGITS else float(text)


def _parquet_table(content: bytes) -> "pa.Table":
    """Table in a Parquet file's `content`; ValueError where it declares too much
    memory.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(pa.BufferReader(content))
    declared: Any = file.metadata
    unpacked = sum(
        declared.row_group(i).total_byte_size for i in range(declared.num_row_groups)
    )
    if declared.num_rows > MOST_ROWS or unpacked > LARGEST_UNPACKED:
        raise ValueError(
            f"it states {declared.num_rows} rows and {unpacked / MEGABYTE:.0f} MB, at"
            f" most {MOST_ROWS} and {LARGEST_UNPACKED // MEGABYTE} MB are read"
        )
    table = file.read(use_threads=False)
    table.validate(full=True)
    _ = table.schema.names  # raises ValueError where they are no text
    return table


def _decode(content: bytes) -> "Image | None":
    """Decode a picture (height, width, 3) to BGR; None where broken, without OpenCV's
    messages.
    """
    import cv2
    import numpy as np

    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    finally:
        cv2.utils.logging.setLogLevel(before)
    return None if image is None else np.asarray(image, dtype=np.uint8)
