"""Mechanics of an emulated arm that its published model lacks."""

from typing import Annotated

from pydantic import Field

from drivers.settings import Settings

Seven = tuple[float, float, float, float, float, float, float]
ZERO_JOINTS: Seven = (0.0,) * 7
Vector = tuple[float, float, float]


class ArmPlant(Settings):
    """Mechanics of an emulated arm beyond its published model; by default sensor noise alone.

    By joint: dry `friction` [N m], viscous `damping` [N m s/rad], a `cable` that pulls towards
    where joints are 0 [N m/rad], `torque_bias` [N m] and `torque_scale` of its sensors,
    `encoder_bias` [rad], and `compliance` [rad/(N m)] between motor and link. A `payload` [kg]
    at `payload_at` (3,) [m in the flange] that nobody stated, a base that leans by `tilt` (2,)
    [rad] about x, then y, shares by which links are heavier (`mass_error`), `delay` [s] beyond what
    the cell knows. `torque_noise` [N m] is one sigma of a reading, drawn from `seed`.
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
    seed: Annotated[int, Field(ge=0)] = 0
