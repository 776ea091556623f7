"""Contact friction: the friction coefficients of contact pairs are not those stated."""

from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    if values[0] != 0.0:
        fields["pair_friction"][:, :2] += values[0]


EFFECT = Effect(
    name="contact_friction",
    sentence="contacts rub more or less than stated",
    of="model",
    source="Coulomb; MJCF pair/friction",
    parameters=lambda m: (
        single("coefficient", "1", 0.01, signed=True, high=50.0) if m.model.npair else ()
    ),
    edit=_edit,
    revealed_by="slide slowly along the contact",
    modes=("forward",),
)
