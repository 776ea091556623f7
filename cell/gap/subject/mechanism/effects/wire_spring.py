"""Wire stiffness: wires pull the hinges of a swinging chain back to hanging straight."""

from dataclasses import replace

from cell.gap.subject.mechanism.effects import cable_spring

EFFECT = replace(
    cable_spring.EFFECT,
    name="wire_spring",
    sentence="wires or cables pull the hinges back like springs",
    shape=lambda _: (),
    modes=("planar",),
    revealed_by="a slow swing: its period shortens",
)
