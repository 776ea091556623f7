"""Drag of still air on moving bodies, with the square of their speed."""

from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array

AIR = 1.2  # kg/m^3


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    (coefficient,) = values
    if coefficient != 0.0:
        fields["opt.density"][...] = fields["opt.density"] + AIR * coefficient


EFFECT = Effect(
    name="air_drag",
    sentence="the air brakes the bodies with the square of their speed",
    of="model",
    source="MuJoCo, fluid forces: ellipsoid model on geoms, or boxes of equal inertia",
    parameters=lambda _: single("coefficient", "1", 0.02),
    edit=_edit,
    revealed_by="large and fast motion against small",
)
