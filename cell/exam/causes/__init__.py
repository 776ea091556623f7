"""Causes that only the makers of exam cases know: no effect of the library is their law."""

from collections.abc import Mapping
from types import MappingProxyType

from cell.exam.causes.broken_in import BrokenIn
from cell.exam.causes.cause import Cause
from cell.exam.causes.clock_drift import ClockDrift
from cell.exam.causes.dahl import Dahl
from cell.exam.causes.draught import Draught
from cell.exam.causes.humidity import Humidity
from cell.exam.causes.lens import LensTouched
from cell.exam.causes.log_creep import LogCreep
from cell.exam.causes.oblique_drag import ObliqueDrag
from cell.exam.causes.power_damping import PowerDamping
from cell.exam.causes.sinh_bending import SinhBending
from cell.exam.causes.smooth_gradient import SmoothGradient
from cell.exam.causes.soft_seam import SoftSeam
from cell.exam.causes.softening import Softening
from cell.exam.causes.static_cling import StaticCling
from cell.exam.causes.wobble import Wobble
from drivers.errors import ConfigurationError
from drivers.settings import parse

CAUSES: Mapping[str, type[Cause]] = MappingProxyType(
    {
        "dahl": Dahl,
        "oblique_drag": ObliqueDrag,
        "sinh_bending": SinhBending,
        "power_damping": PowerDamping,
        "smooth_gradient": SmoothGradient,
        "soft_seam": SoftSeam,
        "log_creep": LogCreep,
        "draught": Draught,
        "static_cling": StaticCling,
        "softening": Softening,
        "broken_in": BrokenIn,
        "humidity": Humidity,
        "wobble": Wobble,
        "clock_drift": ClockDrift,
        "lens": LensTouched,
    }
)

AMOUNT: Mapping[str, str] = MappingProxyType(
    {
        "dahl": "yield_curvature",
        "oblique_drag": "coefficient",
        "sinh_bending": "cubic",
        "power_damping": "coefficient",
        "smooth_gradient": "slope",
        "soft_seam": "factor",
        "log_creep": "ratio",
        "draught": "speed",
        "static_cling": "pressure",
        "softening": "loss",
        "broken_in": "factor",
        "humidity": "spread",
        "wobble": "amplitude",
        "clock_drift": "drift",
        "lens": "k1",
    }
)
"""The parameter that says how much of a cause there is.

Of one that resembles an effect it has the name and the meaning of that effect's own: as much of
either changes a fold about as much.
"""


def cause_of(name: str, values: Mapping[str, float]) -> Cause:
    """The cause called `name`; ConfigurationError for another name or bad values."""
    if name not in CAUSES:
        raise ConfigurationError(f"causes: {name}: is not known; known: {', '.join(CAUSES)}")
    return parse(dict(values), CAUSES[name], f"causes: {name}")
