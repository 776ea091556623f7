"""Hidden cause: the camera's clock drifts from the arm's."""

from typing import ClassVar

from pydantic import Field

from tests.lab.exam.causes.cause import Cause, Sizes


class ClockDrift(Cause):
    """Image stamps run ahead of the arm's clock by the share `drift` of the time since the grasp.

    Clocks agree at the grasp. Source: assumed; stamps by counting frames of too slow a camera.
    """

    amount: ClassVar[str] = "drift"
    sizes: ClassVar[Sizes] = {"medium": {"drift": 0.006}, "strong": {"drift": 0.015}}

    drift: float = Field(ge=0, le=0.05)

    def image_time(self, since: float) -> float:
        """True time [s] after the grasp that an image stamped `since` [s] after the grasp shows."""
        return since / (1.0 + self.drift)


CAUSE = ClockDrift
