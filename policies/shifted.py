"""The triangle moved up: the best open loop, and the baseline that feedback has to beat."""

from policies.follower import PathPolicy
from policies.path import Path, triangular

# m. Over the paper's range at 0.1 m/s |d| is least in the mean at 40 mm, at worst at 43 mm.
RISE = 0.042


class Shifted(PathPolicy):
    """The triangle moved up by `rise` [m], the same for every fabric."""

    name = "shifted"

    def __init__(self, rise: float = RISE) -> None:
        super().__init__()
        self.rise = rise

    def path(self, length: float) -> Path:
        """The raised triangle over a strip of `length` [m]."""
        return triangular(length, self.rise)
