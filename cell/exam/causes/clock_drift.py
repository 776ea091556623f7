"""Cause: the camera's clock drifts from the arm's."""

from typing import ClassVar

from pydantic import Field

from cell.exam.causes.cause import Cause, Sizes


class ClockDrift(Cause):
    """Stamps run ahead by a share `drift` of the time since the grasp, when clocks were compared.

    Source: assumed; a stamp by the count of frames of a camera that is slower than stated.
    """

    amount: ClassVar[str] = "drift"
    sizes: ClassVar[Sizes] = {"medium": {"drift": 0.006}, "strong": {"drift": 0.015}}

    drift: float = Field(ge=0, le=0.05)

    def image_time(self, since: float) -> float:
        """True time of the world in an image stamped `since`."""
        return since / (1.0 + self.drift)


CAUSE = ClockDrift
