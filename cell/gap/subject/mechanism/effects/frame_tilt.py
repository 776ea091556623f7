"""A frame that stands tilted in the plane of a swinging chain."""

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    (angle,) = values
    if angle != 0.0:
        size = np.linalg.norm(mechanism.model.opt.gravity)
        fields["opt.gravity"][:] = (size * np.sin(angle), 0.0, -size * np.cos(angle))


EFFECT = Effect(
    name="frame_tilt",
    sentence="the frame stands tilted",
    of="rig",
    source="rotation of gravity in the plane of motion",
    parameters=lambda _: single("angle", "rad", 0.002, signed=True, high=100.0),
    edit=_edit,
    modes=("planar",),
    revealed_by="let it hang still and read the angle",
)
