"""Protocol of a part: a value that another process can measure."""

from typing import Protocol

from cell.studies.benchmark.results import Result


class Part(Protocol):
    """One measurement; the same part gives the same result."""

    @property
    def key(self) -> str:
        """Unique key with all parameters of the part."""

    @property
    def of(self) -> str:
        """Digest of the files that the result depends on."""

    @property
    def cost(self) -> float:
        """Estimated time on one core [s]."""

    def measure(self) -> Result:
        """Its result; raises CellError where there is none."""
