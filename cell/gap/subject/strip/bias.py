"""What a cell's perception gets wrong alike in every run, as it was measured."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cell.gap.subject.subject import Samples
from drivers.types import Array, frozen

BIASES: Mapping[str, float] = MappingProxyType(
    {
        "profile": 2e-5,
        "contact_x": 1.2e-4,
        "touch_time": 0.003,
        "touch_x": 1.7e-4,
        "displacement": 3.4e-4,
    }
)
"""Root mean square over strips of the mean error of a run [m, s]: `measure_bias` of the benchmarks,
six strips on the twin; of the touch's place half that of the displacement, as l1 and l2 err alike.
"""


def common_errors(samples: Samples) -> dict[str, Array]:
    """Residuals (n,) [SI] that one sigma of each error makes: by quantity, the profile by zone."""
    found: dict[str, Array] = {}
    for quantity, size in BIASES.items():
        of = samples.quantity == quantity
        for zone in dict.fromkeys(map(str, samples.zone[of])) if quantity == "profile" else ("",):
            here = of & (samples.zone == zone) if zone else of
            if here.any():
                found[f"{quantity} {zone}".strip()] = frozen(size * here.astype(np.float64))
    return found
