"""Settings of the touched points: positions, images per point, acceptance criteria."""

from typing import Annotated

from pydantic import Field

from drivers.settings import Settings

Count = Annotated[int, Field(ge=3, le=12)]


class TouchSettings(Settings):
    """Positions to touch, images per point, and acceptance criteria.

    The points lie on a grid of `columns` x `rows` over the work area [m]; every `hold_out`-th is
    held out of the fit and used for the verdict. An image is accepted when two in a row agree
    within `still` [px] and the arm within `arm_still` [m]. A point that disagrees is touched once
    more.
    """

    x_min: float = Field(0.02, ge=-0.5, le=1.0)
    x_max: float = Field(0.60, gt=0, le=2.0)
    z_min: float = Field(0.015, ge=0.0, le=0.2)
    z_max: float = Field(0.30, gt=0, le=1.0)
    columns: Count = 6
    rows: Count = 4
    hold_out: int = Field(4, ge=2, le=10)
    still: float = Field(0.3, gt=0, le=2)
    arm_still: float = Field(0.0005, gt=0, le=0.005)
    patience: int = Field(8, ge=2, le=100)  # images at one pose before it is given up
    worst_mm: float = Field(1.0, gt=0, le=10)  # allowed at the held-out points
    median_mm: float = Field(0.5, gt=0, le=10)  # likewise, their median
    halves_mm: float = Field(1.5, gt=0, le=10)  # by which maps from two halves may differ
    good_mm: float = Field(0.3, gt=0, le=10)  # rms under which there is nothing to improve
    rejected: int = Field(2, ge=0, le=10)  # points that may be left out at the end
    wild: float = Field(0.25, gt=0, lt=0.5)  # share of the first touches that may be wild
    spread: float = Field(0.6, gt=0, le=1)  # share of the work area that used points enclose
