"""The seam of a part: a value that another process can carry out."""

from typing import Protocol

from cell.benchmark.results import Result


class Part(Protocol):
    """One thing to measure; the same part gives the same result."""

    @property
    def key(self) -> str:
        """Names it among the parts, and tells all its numbers."""
        ...

    @property
    def of(self) -> str:
        """What it is made of: a digest of the files that its result depends on."""
        ...

    @property
    def cost(self) -> float:
        """About how many seconds of one core it takes."""
        ...

    def measure(self) -> Result:
        """Its result; raises CellError where there is none."""
        ...
