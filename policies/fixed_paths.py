"""Paths without feedback: triangular, circular, and the shifted triangle."""

from policies.follower import PathPolicy
from policies.path import Path, circular, triangular


class Triangular(PathPolicy):
    """The triangular path: up to (L/2, L/2), down to (0, 0); exact for an infinitely flexible strip
    that never slips (paper, state of the art).
    """

    name = "triangular"

    def path(self, length: float) -> Path:
        """The triangle over a strip of `length` [m]."""
        return triangular(length)


class Circular(PathPolicy):
    """The circular path: half a circle about (L/2, 0) (paper, state of the art)."""

    name = "circular"

    def path(self, length: float) -> Path:
        """The half circle over a strip of `length` [m]."""
        return circular(length)


# m. Over the paper's range at 0.1 m/s |d| is least in the mean at 40 mm, at worst at 43 mm.
PAPER_RISE = 0.042


class Shifted(PathPolicy):
    """The triangular path moved up by `rise` [m], the same for every fabric."""

    name = "shifted"

    def __init__(self, rise: float = PAPER_RISE) -> None:
        super().__init__()
        self.rise = rise

    def path(self, length: float) -> Path:
        """The raised triangle over a strip of `length` [m]."""
        return triangular(length, self.rise)
