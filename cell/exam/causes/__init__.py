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

STEPS: Mapping[str, tuple[str, float, float, float]] = MappingProxyType(
    {
        "dahl": ("yield_curvature", 15.0, 28.0, 49.0),
        "oblique_drag": ("coefficient", 7.0, 18.0, 50.0),
        "sinh_bending": ("cubic", 7e-5, 2.7e-4, 1e-3),
        "power_damping": ("coefficient", 4e-3, 7e-3, 1.5e-2),
        "smooth_gradient": ("slope", 0.8, 1.4, 1.9),
        "soft_seam": ("factor", 1.3, 2.0, 4.7),
        "log_creep": ("ratio", 0.6, 0.8, 0.9),
        "draught": ("speed", 0.2, 0.33, 0.53),
        "static_cling": ("pressure", 1.6, 4.0, 13.5),
        "softening": ("loss", 0.85, 0.92, 0.98),
        "broken_in": ("factor", 0.77, 0.59, 0.2),
        "humidity": ("spread", 0.12, 0.3, 0.75),
        "wobble": ("amplitude", 0.0018, 0.0033, 0.006),
        "clock_drift": ("drift", 0.003, 0.008, 0.02),
        "lens": ("k1", 0.05, 0.1, 0.2),
    }
)
"""The parameter that says how much of a cause there is: weak, medium and strong.

For denim, from the excess gap that is left after the base is refitted. Those of smooth_gradient,
log_creep and softening do not reach it at any strength; clock_drift and lens are guesses.
"""


def cause_of(name: str, values: Mapping[str, float]) -> Cause:
    """The cause called `name`; ConfigurationError for another name or bad values."""
    if name not in CAUSES:
        raise ConfigurationError(f"causes: {name}: is not known; known: {', '.join(CAUSES)}")
    return parse(dict(values), CAUSES[name], f"causes: {name}")
