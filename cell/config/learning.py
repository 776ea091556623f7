"""Settings of the bias that a cell learns from its own folds."""

from typing import Literal

from pydantic import Field

from drivers.settings import Settings


class LearningSettings(Settings):
    """Settings of learning: whether a cell learns, and one-sigma priors [m] of its bias.

    `auto` learns with a real arm or camera and leaves folds of the twin repeatable by their seed.
    The priors are assumptions, about the accuracy of a careful set-up, and belong to no cell;
    where one rests on a measurement, its comment says on which.
    """

    use: Literal["auto", "on", "off"] = "auto"
    cell: float = Field(0.001, gt=0, le=0.02)
    strip: float = Field(0.001, gt=0, le=0.02)
    specimen: float = Field(0.001, gt=0, le=0.02)
    rig: float = Field(0.003, gt=0, le=0.02)  # unseen by the camera: a tool off, a camera moved
    changed: float = Field(0.003, gt=0, le=0.02)  # of the cell after something moved
    repeat: float = Field(0.0003, gt=0, le=0.01)  # of a specimen's folds; 0.2 mm on the twin
    ruler: float = Field(0.0005, gt=0, le=0.01)  # of an edge offset read by eye
    laid: float = Field(0.0006, gt=0, le=0.01)  # of laid edges as seen; laid.yaml has 0.44 mm
    off: float = Field(0.2, gt=0, lt=1)  # share of cells and specimens with something off
    usual: float = Field(0.0004, gt=0, le=0.01)  # of specimens in a right cell; critic's left_out
    misread: float = Field(0.00025, gt=0, le=0.01)  # of a specimen's touch as seen
    limit: float = Field(0.008, gt=0, le=0.008)  # of the correction
