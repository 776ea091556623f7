"""Row of the record for one cycle of the control loop."""

from dataclasses import dataclass
from typing import Self

from drivers.types import ArmState

NOT_MEASURED = float("nan")


@dataclass(frozen=True, slots=True)
class Tick:
    """Row of ticks.parquet: pose, command, force and state of the cell in one control cycle.

    Measured `x`, `z` [m] and `pitch` [rad] at `t` [s], commanded `x_cmd`, `z_cmd` [m], force `f_x`,
    `f_z` [N] on the gripper, and `cost`, the computing time [s]; NaN where not measured.
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
