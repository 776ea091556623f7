"""Friction of contacts, other than stated."""

from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    if not mechanism.model.npair:
        return ()
    return single("coefficient", "1", 0.01, signed=True, high=50.0)


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    if values[0] != 0.0:
        fields["pair_friction"][:, :2] += values[0]


EFFECT = Effect(
    name="contact_friction",
    sentence="contacts rub more or less than stated",
    of="model",
    source="Coulomb; MJCF pair/friction",
    parameters=_parameters,
    edit=_edit,
    revealed_by="slide slowly along the contact",
    modes=("forward",),
)
