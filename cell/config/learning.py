"""Settings of the bias that a cell learns from its own folds."""

from typing import Literal

from pydantic import Field

from drivers.settings import Settings


class LearningSettings(Settings):
    """Whether a cell learns, and one-sigma priors of its bias; lengths [m].

    `auto` learns with a real arm or camera and leaves folds of the twin repeatable by their seed.
    The priors are assumed, about the accuracy of a careful set-up; `repeat` is the scatter of one
    specimen's folds (0.2 mm on the twin), `ruler` that of an edge offset read by eye.
    """

    use: Literal["auto", "on", "off"] = "auto"
    cell: float = Field(0.001, gt=0, le=0.02)
    strip: float = Field(0.001, gt=0, le=0.02)
    specimen: float = Field(0.001, gt=0, le=0.02)
    rig: float = Field(0.003, gt=0, le=0.02)  # unseen by the camera: a tool off, a camera moved
    changed: float = Field(0.003, gt=0, le=0.02)  # of the cell after something moved
    repeat: float = Field(0.0003, gt=0, le=0.01)
    ruler: float = Field(0.0005, gt=0, le=0.01)
    laid: float = Field(0.0007, gt=0, le=0.01)  # by which a camera misreads laid edges: laid.yaml
    off: float = Field(0.2, gt=0, lt=1)  # share of cells or specimens with something off, assumed
    usual: float = Field(0.0004, gt=0, le=0.01)  # of a right cell's specimens: left_out of weights
    misread: float = Field(0.00025, gt=0, le=0.01)  # by which a camera misreads a specimen's touch
    limit: float = Field(0.008, gt=0, le=0.008)  # of the correction
