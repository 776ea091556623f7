"""Common errors of all runs that a camera recorded: of perception and of the model."""

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
    """One sigma [m, s] of the mean error of half a run. Written by `cell study perception`.

    `edge` is by how much the near edge is seen too far out, which moves the whole profile; of the
    others each errs by itself, the profile beside that.
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
    """One sigma of the share by which a fitted `damping` is off beyond noise, as two engines differ
    in it. Written by `cell study damping`.
    """

    schema_: Literal[1] = Field(1, alias="schema")
    damping: float
    strips: int
    source: str
    belongs_to: str


@cache
def bias() -> Bias:
    """The errors of this version's perception."""
    return load(BIAS_FILE, Bias)


@cache
def model_error() -> ModelError:
    """Error of this version's strip model."""
    return load(DAMPING_FILE, ModelError)


def half(x: float, length: float) -> str:
    """Half of the strip over which a gripper at `x` [m] is: `before` or `past` the middle."""
    return PATH_HALVES[int(x < length / 2)]


def common_errors(samples: Samples, halves: Words) -> dict[str, Array]:
    """Residuals (n,) [m, s] that one sigma of each error makes, by name; `halves` (n,) says of
    each sample whether the gripper is before or past the middle.

    What is lifted shows its near edge on the other side once the gripper is past the middle.
    """
    sizes, profile = bias(), samples.quantity == "profile"
    found = {"near edge": frozen(sizes.edge * profile * np.where(halves == "past", 1.0, -1.0))}
    for quantity in ("profile", "contact_x", "touch_time", "touch_x", "displacement"):
        of = samples.quantity == quantity
        parts = _error_groups(quantity, samples, halves)
        for part in dict.fromkeys(map(str, parts[of])):
            here = of & (parts == part)
            found[f"{quantity} {part}".strip()] = frozen(
                getattr(sizes, quantity) * here.astype(np.float64)
            )
    return found


def _error_groups(quantity: str, samples: Samples, halves: Words) -> Words:
    """Groups (n,) of samples with one common error: profile by zone and half, contact, touch."""
    if quantity == "profile":
        return np.array([f"{z} {h}" for z, h in zip(samples.zone, halves, strict=True)])
    return halves if quantity == "contact_x" else np.full(len(halves), "")
