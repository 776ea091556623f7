"""Effects on bodies: their place, mass and its centre, drag of the air, gravity when
tilted.

Source of places: Mooring, Roth, Driels 1991, Fundamentals of Manipulator Calibration.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cell.gap.subject.mechanism.effect import (
    MechanismEffect,
    add_to,
    errors,
    per_joint,
    single_parameter,
)
from cell.gap.subject.mechanism.model import MODES, PLANAR, Mechanism, add_point, tip
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

AIR = 1.2  # kg/m^3
# of the longest link, by which joints lie elsewhere; m of it
LINK_ERROR, SHORTEST = 0.05, 0.01


def _moving_bodies(mechanism: Mechanism) -> list[int]:
    """Numbers of the bodies with a mass that joints move."""
    model = mechanism.model
    return [
        i
        for i in range(1, model.nbody)
        if model.body_weldid[i] and model.body_mass[i] > 0.0
    ]


def _edit_inertia(mechanism: Mechanism, values: Array, edited: Any) -> None:
    """Scale the mass and inertia of each moving body in the MuJoCo model `edited` by
    one plus its relative error in `values`.
    """
    for i, error in zip(_moving_bodies(mechanism), values, strict=True):
        edited.body_mass[i] *= 1.0 + error
        edited.body_inertia[i] *= 1.0 + error


def _carried_bodies(mechanism: Mechanism) -> list[int]:
    """Numbers of the bodies whose joints are carried by other joints, so that an error
    of their position shows in the motion.
    """
    model = mechanism.model
    bodies = np.unique(model.jnt_bodyid)
    return [body for body in bodies if model.body_weldid[model.body_parentid[body]]]


def _place_parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters of errors in the positions [m] of carried bodies along the axes of
    their parents, with a prior set by the longest link.
    """
    model = mechanism.model
    bodies = _carried_bodies(mechanism)
    lengths = np.linalg.norm(model.body_pos[bodies], axis=-1)
    spread = LINK_ERROR * max([SHORTEST, *lengths.tolist()])
    return tuple(
        Parameter(
            name=f"{axis}_{model.body(body).name or body}",
            unit="m",
            start=0.0,
            low=-10.0 * spread,
            high=10.0 * spread,
            step=1e-4 * spread,
            spread=spread,
        )
        for body in bodies
        for axis in "xyz"
    )


def _edit_places(mechanism: Mechanism, values: Array, edited: Any) -> None:
    """Move the bodies in the MuJoCo model `edited` whose joints are carried by other
    joints, by the offsets `values` [m].
    """
    edited.body_pos[_carried_bodies(mechanism)] += values.reshape(-1, 3)


def _com_parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters of the errors [m] in the centre of mass of the mechanism's last body,
    one along each of its axes.
    """
    size = 0.01 * max(np.abs(mechanism.model.body_ipos).max(), 0.01)
    return tuple(
        p for axis in "xyz" for p in single_parameter(axis, "m", size, signed=True)
    )


def _edit_com(mechanism: Mechanism, values: Array, edited: Any) -> None:
    body, _ = tip(mechanism.model)
    edited.body_ipos[body] += values


def _edit_drag(mechanism: Mechanism, values: Array, edited: Any) -> None:
    """Make the air of the MuJoCo model `edited` denser by the first of `values`, as a
    multiple of the density of air, so that it brakes all bodies more.
    """
    edited.opt.density += AIR * values[0]


def _lean(edited: Any, x: float, y: float) -> None:
    """Rotate the gravity of the MuJoCo model `edited` by `x` [rad] about the x axis of
    the world, and by `y` [rad] about its y axis.
    """
    gravity = edited.opt.gravity
    gravity[:] = Rotation.from_euler("xy", [x, y]).apply(gravity)


ARMATURE = MechanismEffect(
    name="armature",
    # times the gear ratio squared
    sentence="drives have rotor inertia that the model lacks",
    parameters=lambda m: per_joint(m, "inertia", "kg m^2", 0.01 * m.inertia),
    edit=add_to("dof_armature"),
    revealed_by="fast starts and stops",
    error_of="armature",
)
PAYLOAD = MechanismEffect(
    name="payload",
    sentence="the last body carries a mass that the model lacks",
    # of what moves, for a flange may weigh next to nothing
    parameters=lambda m: single_parameter(
        "mass", "kg", 0.01 * max(m.model.body_mass[_moving_bodies(m)])
    ),
    edit=lambda m, values, edited: add_point(edited, values[0], *tip(m.model)),
    revealed_by="the same motion at several speeds",
)
COM_ERROR = MechanismEffect(
    name="com_error",
    sentence="the last body's centre of mass is not where the model has it",
    parameters=_com_parameters,
    edit=_edit_com,
    revealed_by="slow motion through many poses",
    error_of="com",
)
AIR_DRAG = MechanismEffect(
    name="air_drag",
    sentence="the air brakes the bodies with the square of their speed",
    parameters=lambda m: single_parameter("coefficient", *m.mode.drag),
    edit=_edit_drag,
    modes=MODES,
    revealed_by="large and fast motion against small",
)
BASE_TILT = MechanismEffect(
    name="base_tilt",
    sentence="the base stands tilted",
    of="rig",
    parameters=lambda _: tuple(
        p
        for axis in "xy"
        for p in single_parameter(axis, "rad", 0.002, signed=True, high=150.0)
    ),
    edit=lambda _, values, edited: _lean(edited, *map(float, values)),
    revealed_by="hold still in several poses, with a level on the base",
)
FRAME_TILT = replace(
    BASE_TILT,
    name="frame_tilt",
    sentence="the frame stands tilted",
    parameters=lambda _: single_parameter(
        "angle", "rad", 0.002, signed=True, high=100.0
    ),
    edit=lambda _, values, edited: _lean(edited, 0.0, -values[0]),
    modes=(PLANAR.name,),
    revealed_by="let it hang still and read the angle",
)
LINK_INERTIA = MechanismEffect(
    name="link_inertia",
    sentence="links are heavier or lighter than stated, with inertia in proportion",
    parameters=lambda m: errors(
        key="error",
        unit="1",
        names=[m.model.body(i).name or i for i in _moving_bodies(m)],
        low=-0.9,
        high=20.0,
        spread=1.0,
    ),
    edit=_edit_inertia,
    probes=(0.3, 3.0, 30.0),
    revealed_by="slow motion through many poses against fast motion",
)
LINK_GEOMETRY = MechanismEffect(
    name="link_geometry",
    sentence="joints lie elsewhere on their links than stated",
    parameters=_place_parameters,
    edit=_edit_places,
    # maps along closed loops are those of stated places
    possible=lambda m: not m.model.neq,
    revealed_by="slow motion through many poses",
)
