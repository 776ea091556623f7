"""What a subject may draw of itself in the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from cell.gap.refit import Estimate


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure as SVG text, with a title."""

    title: str
    svg: str


@runtime_checkable
class Draws(Protocol):
    """A subject that can draw held-out runs as they were measured and as they are simulated."""

    def drawings(self, before: Estimate, after: Estimate) -> Sequence[Drawing]:
        """Figures of the same held-out runs under the refitted base and the accepted model."""
        ...
