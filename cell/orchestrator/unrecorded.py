"""A run that leaves no record: a calibration, whose result is its own file."""

from typing import Any

from calibration.perception.sight import Sight
from cell.senses import Senses
from drivers.types import Frame
from policies.policy import Decision


class Unrecorded:
    """Takes everything a recorder takes and keeps nothing."""

    origin = 0.0

    def describe(self, **facts: Any) -> None:
        """Not kept."""

    def begin(self, clock: float) -> None:
        """Nothing to begin."""

    def tick(self, senses: Senses, cost: float) -> None:
        """Not kept."""

    def sight(self, sight: Sight) -> None:
        """Not kept."""

    def frame(self, frame: Frame) -> None:
        """Not kept."""

    def decision(self, senses: Senses, decision: Decision) -> None:
        """Not kept."""

    def event(self, clock: float, kind: str, **facts: Any) -> None:
        """Not kept."""
