"""Mechanics of the Franka arm with its hand, from published numbers: torques, MJCF,
URDF.
"""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, NonNegativeInt

from drivers.base.settings import Settings
from drivers.base.types import GRAVITY, Array, frozen
from drivers.franka import limits
from drivers.franka.kinematics import (
    FLANGE,
    FLANGE_TO_TIP,
    PARAMETERS,
    PUBLISHED,
    offset_in_frame,
)

MASSES = frozen(PUBLISHED["masses"])  # kg, of links 1 to 7
CENTRES = frozen(PUBLISHED["centres"])  # m, of mass, in the joints' frames
# kg m^2 about the centres, in the joints' frames: xx, yy, zz, xy, xz, yz
INERTIAS = frozen(PUBLISHED["inertias"])
HAND_INERTIA = (0.001, 0.0025, 0.0017)  # kg m^2, about its own axes, as Desk states it
HAND_MASS = 0.73  # kg, as Desk states it
HAND_CENTRE = (-0.01, 0.0, 0.03)  # m in the flange, likewise

Seven = tuple[float, float, float, float, float, float, float]
ZERO_JOINTS: Seven = (0.0,) * 7
Vector = tuple[float, float, float]


class ArmPlant(Settings):
    """Mechanics of an emulated arm beyond its published model; by default sensor noise
    alone.

    By joint: dry `friction` [N m], viscous `damping` [N m s/rad], a `cable` that pulls
    towards where joints are 0 [N m/rad], `torque_bias` [N m] and `torque_scale` of its
    sensors,
    `encoder_bias` [rad], and `compliance` [rad/(N m)] between motor and link. A
    `payload` [kg] at `payload_at` (3,) [m in the flange] that nobody stated, a base
    that leans by `tilt` (2,) [rad] about x, then y, shares by which links are heavier
    (`mass_error`), `delay` [s] beyond what the cell knows. `torque_noise` [N m] is one
    sigma of a reading, drawn from `seed`.
    """

    friction: Seven = ZERO_JOINTS
    damping: Seven = ZERO_JOINTS
    cable: Seven = ZERO_JOINTS
    torque_bias: Seven = ZERO_JOINTS
    torque_scale: Seven = ZERO_JOINTS
    encoder_bias: Seven = ZERO_JOINTS
    compliance: Seven = ZERO_JOINTS
    mass_error: Seven = ZERO_JOINTS
    payload: float = Field(0.0, ge=0, le=3)
    payload_at: Vector = (0.0, 0.0, 0.1034)
    tilt: tuple[float, float] = (0.0, 0.0)
    delay: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    torque_noise: Annotated[float, Field(ge=0, le=5)] = 0.03
    seed: NonNegativeInt = 0


class ArmModel:
    """Joint torques of the arm with a hand or load by its published masses (MuJoCo)."""

    def __init__(
        self, mass: float = HAND_MASS, centre: ArrayLike = HAND_CENTRE
    ) -> None:
        """Arm with `mass` [kg] at its `centre` (3,) [m in the flange's frame]."""
        import mujoco  # slow, and settings that need no torques are read first

        self._inverse = mujoco.mj_inverse
        self.model = mujoco.MjModel.from_xml_string(arm_mjcf())
        self.data = mujoco.MjData(self.model)
        hand = self.model.body("hand")
        hand.mass[:] = mass
        hand.ipos[:] = np.add(centre, (0.0, 0.0, FLANGE))

    def torques(
        self, q: ArrayLike, rate: ArrayLike = 0.0, change: ArrayLike = 0.0
    ) -> Array:
        """Torques (7,) [N m] at joints `q` (7,) [rad], by default those that hold the
        arm.

        In motion `rate` [rad/s] and its `change` [rad/s^2] are given, (7,) each.
        """
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, rate, change
        self._inverse(self.model, data)
        return np.array(data.qfrc_inverse)


def arm_mjcf() -> str:
    """MJCF text of the arm: `joint1` to `joint7` with motors, hand, sites `flange` and
    `tip`.
    """
    links = "".join(_open_link(i) for i in range(7))
    ends = 7 * "</body>"
    motors = "".join(
        f'<motor name="motor{i + 1}" joint="joint{i + 1}" forcelimited="true" '
        f'forcerange="-{limits.LARGEST_TORQUE[i]:g} {limits.LARGEST_TORQUE[i]:g}"/>'
        for i in range(7)
    )
    return (
        '<mujoco model="arm"><compiler angle="radian"/>'
        f'<option gravity="0 0 -{GRAVITY}" integrator="RK4"/>'
        f"<worldbody>{links}{_hand()}{ends}</worldbody><actuator>{motors}</actuator></mujoco>\n"
    )


def _open_link(i: int) -> str:
    """MJCF opening tags of link `i`, counted from 0, with its inertia and joint; the
    next link nests in it.
    """
    a, _, alpha = PARAMETERS[i]
    across, along = offset_in_frame(i)
    turn = np.cos(alpha / 2), np.sin(alpha / 2), 0.0, 0.0
    return (
        f'<body name="link{i + 1}" pos="{_text((a, across, along))}"'
        f' quat="{_text(turn)}"><inertial pos="{_text(CENTRES[i])}"'
        f' mass="{MASSES[i]:.9g}" fullinertia="{_text(INERTIAS[i])}"/><joint'
        f' name="joint{i + 1}" axis="0 0 1"/>'
    )


def _hand() -> str:
    """MJCF of flange, tip and hand in the last link, whose frame lies FLANGE before the
    flange.
    """
    tip = np.add(FLANGE_TO_TIP[:3, 3], (0.0, 0.0, FLANGE))
    centre = np.add(HAND_CENTRE, (0.0, 0.0, FLANGE))
    return (
        f'<site name="flange" pos="0 0 {FLANGE}"/><site name="tip" pos="{_text(tip)}"/>'
        '<body name="hand">'
        f'<inertial pos="{_text(centre)}" mass="{HAND_MASS:.9g}" '
        f'diaginertia="{_text(HAND_INERTIA)}"/></body>'
    )


def arm_urdf(revision: limits.Revision = "fr3") -> str:
    """URDF text of the arm: seven joints with their published limits, and the flange as
    link8.

    The clients read `limit` and `position_based_velocity_limits` of joint1 to joint7.
    Masses are placeholders: the kinematic twin has none.
    """
    inertia = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
    links = "".join(
        f'<link name="link{number}"><inertial><mass'
        f' value="1"/>{inertia}</inertial></link>\n'
        for number in range(9)
    )
    joint_limits = limits.PUBLISHED[revision]
    joints = "".join(_urdf_joint(number, joint_limits) for number in range(7))
    flange = (
        '<joint name="joint8" type="fixed"><parent link="link7"/><child link="link8"/>'
        f'<origin xyz="0 0 {FLANGE}" rpy="0 0 0"/></joint>\n'
    )
    return (
        f'<?xml version="1.0"?>\n<robot name="fr3">\n{links}{joints}{flange}</robot>\n'
    )


def _urdf_joint(index: int, joint_limits: limits.JointLimits) -> str:
    """URDF of the joint between link `index`, from 0, and the next one, with its
    limits.
    """
    a, _, alpha = PARAMETERS[index]
    across, along = offset_in_frame(index)
    span = (
        f'<limit lower="{joint_limits.lower[index]}"'
        f' upper="{joint_limits.upper[index]}"'
        f' velocity="{joint_limits.velocity[index]}"'
        f' effort="{limits.LARGEST_TORQUE[index]}"/>'
    )
    braking = (
        "<position_based_velocity_limits"
        f' velocity_offset="{joint_limits.offset[index]}"'
        f' deceleration_limit="{joint_limits.deceleration[index]}"/>'
    )
    return (
        f'<joint name="joint{index + 1}" type="revolute"><parent'
        f' link="link{index}"/><child link="link{index + 1}"/><origin xyz="{a} {across}'
        f' {along}" rpy="{alpha} 0 0"/><axis xyz="0 0 1"/>{span}{braking}</joint>\n'
    )


def _text(values: "Array | tuple[float, ...]") -> str:
    return " ".join(f"{float(v) + 0.0:.9g}" for v in values)
