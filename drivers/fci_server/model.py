"""The robot's description that the server sends: a URDF from the published numbers."""

from drivers.franka import limits
from drivers.franka.kinematics import FLANGE, PARAMETERS, offset_in_frame


def robot_model() -> str:
    """URDF text with seven joints, their limits, and the flange as link8.

    The clients read `limit` and `position_based_velocity_limits` of joint1 to joint7. Masses are
    placeholders: the kinematic twin has none.
    """
    links = "".join(_link(number) for number in range(9))
    joints = "".join(_joint(number) for number in range(7))
    return f'<?xml version="1.0"?>\n<robot name="fr3">\n{links}{joints}{_flange()}</robot>\n'


def _link(number: int) -> str:
    inertia = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
    return f'<link name="link{number}"><inertial><mass value="1"/>{inertia}</inertial></link>\n'


def _joint(index: int) -> str:
    a, _, alpha = PARAMETERS[index]
    across, along = offset_in_frame(index)
    span = (
        f'<limit lower="{limits.POSITION_LOW[index]}" upper="{limits.POSITION_HIGH[index]}" '
        f'velocity="{limits.VELOCITY[index]}" effort="{limits.LARGEST_TORQUE[index]}"/>'
    )
    braking = (
        f'<position_based_velocity_limits velocity_offset="{limits.VELOCITY_OFFSET[index]}" '
        f'deceleration_limit="{limits.DECELERATION[index]}"/>'
    )
    return (
        f'<joint name="joint{index + 1}" type="revolute"><parent link="link{index}"/>'
        f'<child link="link{index + 1}"/><origin xyz="{a} {across} {along}" rpy="{alpha} 0 0"/>'
        f'<axis xyz="0 0 1"/>{span}{braking}</joint>\n'
    )


def _flange() -> str:
    return (
        '<joint name="joint8" type="fixed"><parent link="link7"/><child link="link8"/>'
        f'<origin xyz="0 0 {FLANGE}" rpy="0 0 0"/></joint>\n'
    )
