"""Hidden causes of the exam: physical laws that differ from every effect of the
library.

They are listed by name here, and so is every plug-in of the kind `causes`.
"""

from collections.abc import Mapping
from functools import cache

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import plugins
from drivers.base.settings import parse
from tests.lab.exam.causes import fabric, rig, surroundings
from tests.lab.exam.causes.cause import Cause

OWN_CAUSES: Mapping[str, type[Cause]] = {
    "broken_in": fabric.BrokenIn,
    "caught_thread": surroundings.CaughtThread,
    "clock_drift": rig.ClockDrift,
    "creeping_grip": rig.CreepingGrip,
    "dahl": fabric.Dahl,
    "draught": surroundings.Draught,
    "humidity": fabric.Humidity,
    "log_creep": fabric.LogCreep,
    "oblique_drag": surroundings.ObliqueDrag,
    "power_damping": fabric.PowerDamping,
    "sinh_bending": fabric.SinhBending,
    "smooth_gradient": fabric.SmoothGradient,
    "soft_seam": fabric.SoftSeam,
    "static_cling": surroundings.StaticCling,
    "sticky_patch": surroundings.StickyPatch,
    "wobble": rig.Wobble,
}


@cache
def causes() -> Mapping[str, type[Cause]]:
    """Classes of all causes by name; raises ConfigurationError for a plug-in of another
    class.
    """
    added = plugins("causes", type, OWN_CAUSES)
    wrong = [name for name, cause in added.items() if not issubclass(cause, Cause)]
    if wrong:
        raise ConfigurationError(
            f"plug-in folding_cell.causes: {wrong[0]}: is no Cause"
        )
    return {**OWN_CAUSES, **added}


def cause_of(name: str, values: Mapping[str, float]) -> Cause:
    """Make the cause `name` from its `values`; raises ConfigurationError if one is
    invalid.
    """
    if name not in causes():
        raise ConfigurationError(
            f"causes: {name}: is not known; known: {', '.join(causes())}"
        )
    return parse(dict(values), causes()[name], f"causes: {name}")
