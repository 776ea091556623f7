"""What a policy foretells of a fold, and of the strip: for the record and for the operator."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and the interval that holds the true one in 68 % of the folds."""

    value: float
    low: float
    high: float

    def text(self, scale: float, digits: int) -> str:
        """Value and interval times `scale`."""
        value, low, high = (f"{scale * v:.{digits}f}" for v in (self.value, self.low, self.high))
        return f"{value} ({low} to {high})"


@dataclass(frozen=True, slots=True)
class Foretold:
    """The `displacement` that a policy expects and one `sigma` of it [m]; what strip it takes it
    to be: bending length [m], retardation time [s], yield curvature of yarn friction [1/m].

    `blind`: no image deserves belief now, so that nothing is foretold of this fold.
    """

    displacement: float
    sigma: float
    bending_length: Estimate
    retardation_time: Estimate
    yield_curvature: Estimate
    blind: bool

    def sentence(self) -> str:
        """For the operator."""
        return (
            f"foretold {1e3 * self.displacement:+.1f} mm, sigma {1e3 * self.sigma:.1f} mm; bending "
            f"length {self.bending_length.text(1e3, 1)} mm, retardation time "
            f"{self.retardation_time.text(1e3, 0)} ms, yarn friction "
            f"{self.yield_curvature.text(1.0, 0)} 1/m"
        )


@runtime_checkable
class Foretelling(Protocol):
    """A policy that says what it expects."""

    def foretold(self) -> Foretold | None:
        """What is expected of the first fold of the batch; None before the first decision."""
        ...
