"""Range of strips that perception was designed for."""

from collections.abc import Iterator

from drivers.strip.file import StripFile

WIDTH = (0.005, 0.20)  # m, both ends folded through images, seen within 1 mm of the truth
THICKNESS = (0.0, 0.004)  # m


def outside_scope(strip: StripFile) -> Iterator[str]:
    """Reasons why perception is not valid for `strip`, a line each; none where it is."""
    bounds = (("width", strip.width, WIDTH), ("thickness", strip.thickness, THICKNESS))
    for key, value, (low, high) in bounds:
        if not low <= value <= high:
            yield (
                f"{key}: is {1e3 * value:g} mm, images are read of strips of {1e3 * low:g} to "
                f"{1e3 * high:g} mm; fold another cut of the fabric"
            )
