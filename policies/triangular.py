"""The triangular path: right for an infinitely flexible strip on a desk that never slips."""

from policies.follower import PathPolicy
from policies.path import Path, triangular


class Triangular(PathPolicy):
    """Up to (L/2, L/2), down to (0, 0) (paper, state of the art)."""

    name = "triangular"

    def path(self, length: float) -> Path:
        """The triangle over a strip of `length` [m]."""
        return triangular(length)
