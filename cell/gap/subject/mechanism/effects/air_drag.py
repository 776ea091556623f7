"""Air drag: still air brakes moving bodies with the square of their speed."""

from cell.gap.subject.mechanism.effect import MODES, Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array

AIR = 1.2  # kg/m^3


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """One parameter: a share of air's density, or a chain's drag per length and squared speed."""
    if mechanism.mode == "planar":
        return single("coefficient", "kg/m^2", 0.01)
    return single("coefficient", "1", 0.02)


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    (coefficient,) = values
    if coefficient == 0.0:
        return
    if mechanism.mode == "planar":
        fields["chain.drag"][...] += coefficient
    else:
        fields["opt.density"][...] = fields["opt.density"] + AIR * coefficient


EFFECT = Effect(
    name="air_drag",
    sentence="the air brakes the bodies with the square of their speed",
    of="model",
    source="MuJoCo, fluid forces: ellipsoid model on geoms, or boxes of equal inertia; on chains "
    "normal to the links, as on cylinders in cross flow",
    parameters=_parameters,
    edit=_edit,
    modes=MODES,
    revealed_by="large and fast motion against small",
)
