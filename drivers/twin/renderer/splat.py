"""Cloud of material points that represents the strip in an image."""

from dataclasses import dataclass

from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Cloud:
    """Material points (6, n): u, v [px], area [px^2], brightness, arc length and depth [m].

    `tint` (n, 3) BGR are colours of their own; empty where all share that of the strip.
    """

    points: Array
    tint: Array

    @property
    def pixels(self) -> tuple[Array, Array]:
        """Columns and rows (n,) [px]."""
        return self.points[0], self.points[1]
