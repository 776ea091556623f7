"""One cycle of the control loop, as a row of the record."""

from dataclasses import dataclass
from typing import Self

from drivers.types import ArmState

NOT_MEASURED = float("nan")


@dataclass(frozen=True, slots=True)
class Tick:
    """Row of ticks.parquet: measured `x`, `z` [m] and `pitch` [rad] at `t` [s], commanded `x_cmd`,
    `z_cmd` [m], force `f_x`, `f_z` [N] on the gripper (NaN where not measured), the `state` of the
    cell, and `cost`, the computing time of the cycle [s].
    """

    t: float
    x: float
    z: float
    pitch: float
    x_cmd: float
    z_cmd: float
    state: str
    f_x: float = NOT_MEASURED
    f_z: float = NOT_MEASURED
    cost: float = NOT_MEASURED

    @classmethod
    def of(cls, arm: ArmState, state: str, cost: float = NOT_MEASURED) -> Self:
        """The row of a measured arm state; `t` is the moment of the joint reading."""
        return cls(
            t=arm.stamp,
            x=arm.pose.x,
            z=arm.pose.z,
            pitch=arm.pose.pitch,
            x_cmd=arm.commanded.x,
            z_cmd=arm.commanded.z,
            state=state,
            f_x=arm.force[0],
            f_z=arm.force[1],
            cost=cost,
        )
