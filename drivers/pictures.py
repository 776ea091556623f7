"""Reads PNG and JPEG pictures of bounded size, whose sides are checked before decoding."""

from pathlib import Path

import cv2
import numpy as np

from drivers.errors import ConfigurationError
from drivers.files import MEGABYTE, read_bytes
from drivers.types import Image

BYTES = 64 * MEGABYTE
LARGEST_SIDE = 16_384  # px, of any camera or phone; a few bytes can declare gigabytes
PNG_SIGNATURE, JPEG_SIGNATURE = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
CHUNK_FRAME = 12  # bytes of a PNG chunk around its data: length, type, checksum
# second bytes of the JPEG markers that begin a frame, whose header holds height and width
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
    if content.startswith(PNG_SIGNATURE) and content[12:16] == b"IHDR":
        if not _holds_its_chunks(content):
            return 0, 0
        return int.from_bytes(content[16:20]), int.from_bytes(content[20:24])
    return _jpeg_sides(content) if content.startswith(JPEG_SIGNATURE) else (0, 0)


def _jpeg_sides(jpeg: bytes) -> tuple[int, int]:
    """Width and height [px] in the first frame header of a JPEG; zeros where there is none."""
    at = len(JPEG_SIGNATURE)
    while at + 9 <= len(jpeg) and jpeg[at] == 0xFF:
        if jpeg[at + 1] in FRAME_MARKERS:
            height, width = jpeg[at + 5 : at + 7], jpeg[at + 7 : at + 9]
            return int.from_bytes(width), int.from_bytes(height)
        is_fill = jpeg[at + 1] == 0xFF
        at += 1 if is_fill else 2 + int.from_bytes(jpeg[at + 2 : at + 4])
    return 0, 0


def _holds_its_chunks(png: bytes) -> bool:
    """Whether a PNG contains the whole data of each of its chunks."""
    at = len(PNG_SIGNATURE)
    while at + CHUNK_FRAME <= len(png):
        ends = png[at + 4 : at + 8] == b"IEND"
        at += CHUNK_FRAME + int.from_bytes(png[at : at + 4])
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
