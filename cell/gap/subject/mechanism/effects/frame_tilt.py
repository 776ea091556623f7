"""Frame tilt: the frame of a swinging chain stands tilted in the plane of motion."""

from dataclasses import replace

from cell.gap.subject.mechanism.effect import single
from cell.gap.subject.mechanism.effects import base_tilt

EFFECT = replace(
    base_tilt.EFFECT,
    name="frame_tilt",
    sentence="the frame stands tilted",
    source="rotation of gravity in the plane of motion",
    parameters=lambda _: single("angle", "rad", 0.002, signed=True, high=100.0),
    edit=lambda _, values, fields: base_tilt.lean(fields, 0.0, -float(values[0])),
    modes=("planar",),
    revealed_by="let it hang still and read the angle",
)
