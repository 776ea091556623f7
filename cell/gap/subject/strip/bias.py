"""Systematic errors that all runs recorded by a camera share: of perception and of the model."""

from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from cell.gap.subject.subject import Samples, Words
from drivers.settings import Settings, load
from drivers.types import Array, frozen

BIAS_FILE = Path(__file__).with_suffix(".yaml")
DAMPING_FILE = BIAS_FILE.with_name("damping.yaml")
PATH_HALVES = ("before", "past")


class Bias(Settings):
    """Standard deviations [m, s] of perception's mean error over half a run, by quantity.

    Written by `python -m tests.lab study perception`. `edge` is how far out the near edge is seen,
    which moves the whole profile; the other errors are independent, that of the profile adds to it.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    edge: float
    profile: float
    contact_x: float
    touch_time: float
    touch_x: float
    displacement: float
    strips: int
    source: str
    belongs_to: str


class ModelError(Settings):
    """Standard deviation of fitted `damping` between engines, as a share.

    Written by `python -m tests.lab study damping`.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    damping: float
    strips: int
    source: str
    belongs_to: str


@cache
def bias() -> Bias:
    """Load the standard deviations of the systematic errors of strip measurements in images."""
    return load(BIAS_FILE, Bias)


@cache
def model_error() -> ModelError:
    """Load the relative standard deviation of fitted damping between simulation engines."""
    return load(DAMPING_FILE, ModelError)


def half(x: float, length: float) -> str:
    """Half of the strip over which a gripper at `x` [m] is: `before` or `past` the middle."""
    return PATH_HALVES[int(x < length / 2)]


def common_errors(samples: Samples, halves: Words) -> dict[str, Array]:
    """Residuals (n,) [m, s] that one standard deviation of each systematic error makes, by name.

    `halves` (n,) is `before` or `past`, as the gripper is before or past the middle: past it, a
    lifted strip shows its near edge on the other side.
    """
    sizes, profile = bias(), samples.quantity == "profile"
    found = {"near edge": frozen(sizes.edge * profile * np.where(halves == "past", 1.0, -1.0))}
    for quantity in ("profile", "contact_x", "touch_time", "touch_x", "displacement"):
        measured = samples.quantity == quantity
        groups = _error_groups(quantity, samples, halves)
        for group in dict.fromkeys(map(str, groups[measured])):
            members = measured & (groups == group)
            found[f"{quantity} {group}".strip()] = frozen(
                getattr(sizes, quantity) * members.astype(np.float64)
            )
    return found


def _error_groups(quantity: str, samples: Samples, halves: Words) -> Words:
    """Label (n,) of each sample's error group: by zone and half, by half, or one group for all."""
    if quantity == "profile":
        return np.array([f"{z} {h}" for z, h in zip(samples.zone, halves, strict=True)])
    return halves if quantity == "contact_x" else np.full(len(halves), "")
