"""Effects of elastic parts: gears, cables, wires, pivots and the base.

Sources: Spong 1987, J. Dyn. Sys. Meas. Control 109 (gears that twist); Nordin and
Gutman 2002, Automatica 38 (play).
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import cont2discrete, lfilter

from cell.gap.subject.mechanism.effect import (
    MechanismEffect,
    per_joint,
    single_parameter,
)
from cell.gap.subject.mechanism.model import PLANAR, PRESCRIBED, Mechanism, poses
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

# rad/s at which bases sway: of the prior's compliance, and of probes; damping ratio
SWAY, SWAYS, DAMPING = 30.0, (12.0, 19.0, 30.0, 48.0, 77.0, 123.0), 0.05
MOTIONS = 64  # of which momenta are cached


def _spring_law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of a spring in parallel to a joint at angles `q` [rad]: minus the
    stiffness `p[at]` times the angle beyond the rest position `p[at + 1]`.
    """
    return -p[at] * (q - p[at + 1])


def _edit_spring(mechanism: Mechanism, values: Array, edited: Any) -> None:
    """Add a spring in parallel to each joint's own in the MuJoCo model `edited`, both
    combined into one stiffness and one rest position.
    """
    for i, (added, rest) in enumerate(CABLE_SPRING.table(mechanism, values).T):
        if added != 0.0:
            own = edited.jnt_stiffness[i]
            own_rest = edited.qpos_spring[i]
            edited.qpos_spring[i] = (own * own_rest + added * rest) / (own + added)
            edited.jnt_stiffness[i] += added


def _sway_parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters of a base that sways elastically: its compliances along and about the
    three axes of the world, its natural frequency and its damping ratio.
    """
    kinds = (
        ("compliance", "m/N", float(mechanism.model.body_mass.sum())),
        ("rocking", "rad/(N m)", float(mechanism.inertia.max())),
    )
    found = [
        p
        for key, unit, moved in kinds
        for axis in "xyz"
        for p in single_parameter(f"{key}_{axis}", unit, 0.04 / (moved * SWAY**2))
    ]
    low, *_, high = SWAYS
    ends = (0.5 * low, 2.0 * high)
    step = 1e-3 * SWAY
    return (
        *found,
        Parameter("frequency", "rad/s", SWAY, *ends, step, high, role="shape"),
    )


def _sway_path(
    mechanism: Mechanism, values: Array, t: Array, q: Array, v: Array
) -> Array:
    """Joint torques [N m or N] on a mechanism whose elastic base sways, a row for each
    time and a column for each joint.

    The motion is q, v (m, joints) over t (m,) [s]; `values` are six compliances c along
    [m/N] and about [rad/(N m)] the base's axes, natural frequency f [rad/s] and damping
    ratio d. By momenta P(q) v of all bodies along and about these axes, and moments w
    of their weight, its place y obeys y'' / f^2 + 2 d y' / f + y = -c ((P v)' - w);
    joints bear P^T y'' - (dw/dq)^T y.
    """
    *compliances, frequency, damping = np.append(values, DAMPING)[:8]
    torque = np.zeros_like(q)
    if not any(compliances):
        return torque

    momenta, weights, slopes = _momenta(mechanism.model, q.tobytes())
    force = (
        make_interp_spline(t, np.einsum("mkn,mn->mk", momenta, v), k=5)(t, nu=1)
        - weights
    )
    law = ([1.0], [frequency**-2, 2.0 * damping / frequency, 1.0])
    by, of, _ = cont2discrete(law, t[1] - t[0], "foh")

    # at the start it follows weights, and rests otherwise
    for k in np.flatnonzero(compliances):
        along = force[:, k]
        slope = slopes[:, k]
        ramp = along[0] - t * (slope[0] @ v[0])
        place = compliances[k] * (lfilter(by[0], of, ramp - along) - ramp)
        faster = make_interp_spline(t, place, k=5)(t, nu=2)
        torque -= faster[:, None] * momenta[:, k] - place[:, None] * slope

    return torque


@lru_cache(MOTIONS)
def _momenta(model: Any, motion: bytes) -> tuple[Array, Array, Array]:
    """Jacobians of the bodies' total momentum along and about the world's axes, the
    moments of their weight, and the slopes of these moments by joint position, each for
    every pose.
    """
    q = np.frombuffer(motion).reshape(-1, model.nv)
    mass = model.body_mass.sum()
    foot = model.body_pos[model.body_rootid[model.jnt_bodyid[0]]]
    arms = np.zeros((len(q), 3))
    linear, angular = np.zeros((2, len(q), 3, model.nv))
    along = poses(model, q, mujoco.mj_kinematics)

    for data, *found, arm in zip(along, linear, angular, arms, strict=True):
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSubtreeCom(model, data, found[0], 0)
        mujoco.mj_angmomMat(model, data, found[1], 0)
        arm[:] = data.subtree_com[0] - foot

    angular += mass * np.cross(arms[:, :, None], linear, axis=1)
    momenta = np.concatenate([mass * linear, angular], axis=1)
    pull = mass * model.opt.gravity
    slopes = np.cross(linear, pull, axisa=1, axisc=1)
    weights = np.cross(arms, pull)
    return momenta, np.hstack([0.0 * arms, weights]), np.hstack([0.0 * linear, slopes])


JOINT_ELASTICITY = MechanismEffect(
    name="joint_elasticity",
    sentence="gears twist: links spring on their motors",
    # a typical one makes the link resonate at 300 times the rate
    parameters=lambda m: per_joint(
        m, "compliance", "rad/(N m)", 0.01 / (m.inertia * (30.0 * m.rate) ** 2)
    ),
    possible=lambda m: m.mode.splits(m.model),
    read="elastic",
    revealed_by="fast starts and stops: the link rings on",
)
BACKLASH = MechanismEffect(
    name="backlash",
    sentence="gears have play",
    parameters=lambda m: per_joint(
        m, "gap", "rad", 0.001 * np.ones(len(m.joints)), high=100.0
    ),
    possible=lambda m: m.mode.splits(m.model),
    read="gap",
    revealed_by="slow motion there and back through the load's turning point",
)
CABLE_SPRING = MechanismEffect(
    name="cable_spring",
    sentence="cables pull joints back like springs",
    parameters=lambda m: per_joint(m, "stiffness", "N m/rad", 0.01 * m.torque),
    shape=lambda m: per_joint(
        m,
        "rest",
        "rad",
        0.05 * np.ones(len(m.joints)),
        signed=True,
        role="shape",
        high=120.0,
    ),
    keys=2,
    law=_spring_law,
    edit=_edit_spring,
    revealed_by="slow motion over the whole range, there and back",
)
WIRE_SPRING = replace(
    CABLE_SPRING,
    name="wire_spring",
    sentence="wires or cables pull the hinges back like springs",
    modes=(PLANAR.name,),
    revealed_by="a slow swing: its period shortens",
)
PIVOT_COMPLIANCE = MechanismEffect(
    name="pivot_compliance",
    sentence="the pivot gives way sideways",
    of="rig",
    parameters=lambda _: single_parameter("compliance", "m/N", 1e-5, high=100.0),
    read="elastic",
    modes=(PLANAR.name,),
    revealed_by="press the frame while it swings",
)
BASE_COMPLIANCE = MechanismEffect(
    name="base_compliance",
    sentence="the base sways or rocks on what it stands on",
    of="rig",
    parameters=_sway_parameters,
    shape=lambda _: (
        Parameter(
            name="damping",
            unit="1",
            start=DAMPING,
            low=1e-3,
            high=1.0,
            step=1e-4,
            spread=0.1,
            role="shape",
        ),
    ),
    path=_sway_path,
    modes=(PRESCRIBED.name,),
    probes=(5.0,),
    grid=SWAYS,
    revealed_by="fast starts and stops, then with the base clamped to the floor",
)
