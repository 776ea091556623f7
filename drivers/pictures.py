"""Reads PNG and JPEG pictures of bounded size, whose sides are checked before decoding."""

from pathlib import Path

import cv2
import numpy as np

from drivers.errors import ConfigurationError
from drivers.files import MEGABYTE, read_bytes
from drivers.types import Image

BYTES = 64 * MEGABYTE
LARGEST_SIDE = 16_384  # px, of any camera or phone; a few bytes can declare gigabytes
# of JPEG
FRAME_MARKERS = (*range(0xC0, 0xC4), *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))


def read_picture(path: Path, side: int = LARGEST_SIDE) -> Image:
    """The picture (height, width, 3) in BGR at `path`, no side longer than `side` [px].

    Raises ConfigurationError for a file that is missing, not regular, no whole PNG or JPEG, or
    larger; nothing is decoded before its sides are known.
    """
    content = read_bytes(path, BYTES)
    width, height = sides(content)
    if max(width, height) > side:
        raise ConfigurationError(
            f"{path}: is {width} x {height} px, at most {side} px are read; make it smaller"
        )
    image = _decode(content) if min(width, height) > 0 else None
    if image is None:
        raise ConfigurationError(f"{path}: is not a picture that can be read; give a JPEG or PNG")
    return np.asarray(image, dtype=np.uint8)


def sides(content: bytes) -> tuple[int, int]:
    """Width and height [px] that the header of a PNG or JPEG declares; zeros for other content.

    Zeros too for a PNG that ends within a chunk: OpenCV allocates what the chunk declares.
    """
    if content.startswith(b"\x89PNG\r\n\x1a\n") and content[12:16] == b"IHDR":
        if not _holds_its_chunks(content):
            return 0, 0
        return int.from_bytes(content[16:20]), int.from_bytes(content[20:24])
    at = 2 if content.startswith(b"\xff\xd8") else len(content)
    while at + 9 <= len(content) and content[at] == 0xFF:
        if content[at + 1] in FRAME_MARKERS:
            height, width = content[at + 5 : at + 7], content[at + 7 : at + 9]
            return int.from_bytes(width), int.from_bytes(height)
        at += 1 if content[at + 1] == 0xFF else 2 + int.from_bytes(content[at + 2 : at + 4])
    return 0, 0


def _holds_its_chunks(png: bytes) -> bool:
    at = 8
    while at + 12 <= len(png):
        ends = png[at + 4 : at + 8] == b"IEND"
        at += 12 + int.from_bytes(png[at : at + 4])
        if ends:
            break
    return at <= len(png)


def _decode(content: bytes) -> Image | None:
    """The picture (height, width, 3) in BGR; None where broken, without messages of OpenCV."""
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    finally:
        cv2.utils.logging.setLogLevel(before)
