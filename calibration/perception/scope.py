"""Strips that perception was made for."""

from collections.abc import Iterator

from drivers.strip.file import StripFile

WIDTH = (0.01, 0.20)  # m
THICKNESS = (0.0, 0.004)  # m


def outside_scope(strip: StripFile) -> Iterator[str]:
    """Why perception cannot be trusted with `strip`, a reason a line; nothing where it can."""
    bounds = (("width", strip.width, WIDTH), ("thickness", strip.thickness, THICKNESS))
    for key, value, (low, high) in bounds:
        if not low <= value <= high:
            yield (
                f"{key}: is {1e3 * value:g} mm, images are read of strips of {1e3 * low:g} to "
                f"{1e3 * high:g} mm; fold another cut of the fabric"
            )
