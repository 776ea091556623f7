"""The circular path: right for a rigid strip that bends only in the folding line."""

from policies.follower import PathPolicy
from policies.path import Path, circular


class Circular(PathPolicy):
    """Half a circle about (L/2, 0) (paper, state of the art)."""

    name = "circular"

    def path(self, length: float) -> Path:
        """The half circle over a strip of `length` [m]."""
        return circular(length)
