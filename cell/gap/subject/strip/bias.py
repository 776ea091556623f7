"""What a cell's perception gets wrong alike in every run, as it was measured."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cell.gap.subject.subject import Samples, Words
from drivers.types import Array, frozen

EDGE = 1.15e-4  # m by which the near edge is seen too far out, which moves the whole profile
BIASES: Mapping[str, float] = MappingProxyType(
    {
        "profile": 4e-5,
        "contact_x": 1.7e-4,
        "touch_time": 0.0044,
        "touch_x": 1.4e-4,
        "displacement": 2.8e-4,
    }
)
"""Root mean square over strips of the mean error of half a run [m, s]: `measure_bias` of the
benchmarks, ten strips on the twin; of the profile beside EDGE, of the touch's place half that of
the displacement, as l1 and l2 err alike.
"""
DAMPING = 0.038
"""Share by which the damping of a fit through images is off beyond noise, one sigma: root mean
square over five strips of what two engines differ by without noise (`measure_damping` of the
benchmarks). Neither damps more: their shapes are 17 um apart, and a percent of damping moves a
shape by 2 um. A rod on a harder desk and a chain of more links come closer.
"""
HALVES = ("before", "past")


def half(x: float, length: float) -> str:
    """Whether a gripper at `x` [m] is `before` or `past` the middle of the strip."""
    return HALVES[int(x < length / 2)]


def common_errors(samples: Samples, halves: Words) -> dict[str, Array]:
    """Residuals (n,) [m, s] that one sigma of each error makes, by name; `halves` (n,) tells for
    each sample whether the gripper is before or past the middle.

    What is lifted shows its near edge on the other side once the gripper is past the middle.
    """
    profile = samples.quantity == "profile"
    found = {"near edge": frozen(EDGE * profile * np.where(halves == "past", 1.0, -1.0))}
    for quantity, size in BIASES.items():
        of = samples.quantity == quantity
        parts = _parts(quantity, samples, halves)
        for part in dict.fromkeys(map(str, parts[of])):
            here = of & (parts == part)
            found[f"{quantity} {part}".strip()] = frozen(size * here.astype(np.float64))
    return found


def _parts(quantity: str, samples: Samples, halves: Words) -> Words:
    """What errs by itself (n,): the profile by zone and half, the contact by half, the touch."""
    if quantity == "profile":
        return np.array([f"{z} {h}" for z, h in zip(samples.zone, halves, strict=True)])
    return halves if quantity == "contact_x" else np.full(len(halves), "")
