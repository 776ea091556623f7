"""Effects of what gives way: gears, cables, wires and pivots."""

from dataclasses import replace
from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, has_gears, per_joint, single
from cell.gap.subject.mechanism.fields import Fields
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _elasticity_parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    if not has_gears(mechanism):
        return ()
    rate = 30.0 * mechanism.rate
    return per_joint(mechanism, "compliance", "rad/(N m)", 0.01 / (mechanism.inertia * rate**2))


def _spring_law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    return -p[at] * (q - p[at + 1])


def _edit_spring(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    """Add a spring in parallel to each joint's own, at their common position of rest."""
    table = CABLE_SPRING.table(mechanism, values)
    for i, joint in enumerate(mechanism.joints):
        added, rest = table[:, i]
        if added != 0.0:
            own, own_rest = fields["jnt_stiffness"][i], fields["qpos_spring"][joint.qpos]
            common_rest = (own * own_rest + added * rest) / (own + added)
            fields["qpos_spring"][joint.qpos] = common_rest
            fields["jnt_stiffness"][i] += added


JOINT_ELASTICITY = Effect(
    name="joint_elasticity",
    sentence="gears twist: links spring on their motors",
    of="model",
    source="Spong 1987, J. Dyn. Sys. Meas. Control 109",
    parameters=_elasticity_parameters,
    read=lambda _, values, readings: setattr(readings, "elastic", values),
    revealed_by="fast starts and stops: the link rings on",
)
BACKLASH = Effect(
    name="backlash",
    sentence="gears have play",
    of="model",
    source="Nordin and Gutman 2002, Automatica 38",
    parameters=lambda m: (
        per_joint(m, "gap", "rad", 0.001 * np.ones(len(m.joints)), high=100.0)
        if has_gears(m)
        else ()
    ),
    read=lambda _, values, readings: setattr(readings, "gap", values),
    revealed_by="slow motion there and back through the load's turning point",
)
CABLE_SPRING = Effect(
    name="cable_spring",
    sentence="cables pull joints back like springs",
    of="model",
    source="Hooke; MJCF joint/stiffness and springref",
    parameters=lambda m: per_joint(m, "stiffness", "N m/rad", 0.01 * m.torque),
    shape=lambda m: per_joint(m, "rest", "rad", 0.05 * np.ones(len(m.joints)), signed=True,
                              shape=True, high=120.0),
    keys=2,
    law=_spring_law,
    edit=_edit_spring,
    revealed_by="slow motion over the whole range, there and back",
)  # fmt: skip
WIRE_SPRING = replace(
    CABLE_SPRING,
    name="wire_spring",
    sentence="wires or cables pull the hinges back like springs",
    shape=lambda _: (),
    modes=("planar",),
    revealed_by="a slow swing: its period shortens",
)
PIVOT_COMPLIANCE = Effect(
    name="pivot_compliance",
    sentence="the pivot gives way sideways",
    of="rig",
    source="a stiff spring without mass: it follows the chain's pull at once",
    parameters=lambda _: single("compliance", "m/N", 1e-5, high=100.0),
    read=lambda _, values, readings: setattr(readings, "elastic", values),
    modes=("planar",),
    revealed_by="press the frame while it swings",
)
EFFECTS = (JOINT_ELASTICITY, BACKLASH, CABLE_SPRING, WIRE_SPRING, PIVOT_COMPLIANCE)
