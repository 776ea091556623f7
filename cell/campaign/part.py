"""Protocol of a part of a campaign: a value that another process can measure."""

from collections.abc import Mapping
from typing import Any, Protocol

from pydantic import BaseModel


class Part(Protocol):
    """Measurement that another process can run, after pickling; equal parts give equal outcomes."""

    @property
    def key(self) -> str:
        """Unique name among the parts."""

    @property
    def of(self) -> str:
        """Digest of the code and files that the outcome depends on."""

    @property
    def cost(self) -> float:
        """Estimated time on one core [s]."""

    def measure(self) -> Mapping[str, Any] | BaseModel:
        """Measure the part: an outcome that JSON can hold; raises CellError where there is none."""
