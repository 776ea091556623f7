"""The Franka arm with its hand as a MuJoCo model without shapes, from published numbers."""

import numpy as np

from drivers.franka import limits
from drivers.franka.gravity import CENTRES, GRAVITY, MASSES
from drivers.franka.kinematics import FLANGE, FLANGE_TO_TIP, PARAMETERS, offset_in_frame
from drivers.types import Array, frozen

# Inertia of links 1 to 7 about their centres of mass [kg m^2]: xx, yy, zz, xy, xz, yz in their
# joints' frames. Source: as the masses, Gaz et al., RA-L 4(4), 2019.
INERTIAS = frozen(
    [
        [0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169],
        [0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704],
        [0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805],
        [0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641],
        [0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229],
        [0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341],
        [0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741],
    ]
)
HAND_INERTIA = (0.001, 0.0025, 0.0017)  # kg m^2, about its own axes, as Desk states it
HAND_MASS, HAND_CENTRE = 0.73, (-0.01, 0.0, 0.03)  # kg, m in the flange, as Desk states them


def arm_mjcf() -> str:
    """MJCF text of the arm: `joint1` to `joint7` with motors, hand, sites `flange` and `tip`."""
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
    """Opening tags of link `i`, counted from 0, with its inertia and joint; the next link nests."""
    a, _, alpha = PARAMETERS[i]
    across, along = offset_in_frame(i)
    turn = np.cos(alpha / 2), np.sin(alpha / 2), 0.0, 0.0
    return (
        f'<body name="link{i + 1}" pos="{_text((a, across, along))}" quat="{_text(turn)}">'
        f'<inertial pos="{_text(CENTRES[i])}" mass="{MASSES[i]:.9g}" '
        f'fullinertia="{_text(INERTIAS[i])}"/>'
        f'<joint name="joint{i + 1}" axis="0 0 1"/>'
    )


def _hand() -> str:
    """MJCF of flange, tip and hand in the last link, whose frame lies FLANGE before the flange."""
    tip = np.add(FLANGE_TO_TIP[:3, 3], (0.0, 0.0, FLANGE))
    centre = np.add(HAND_CENTRE, (0.0, 0.0, FLANGE))
    return (
        f'<site name="flange" pos="0 0 {FLANGE}"/><site name="tip" pos="{_text(tip)}"/>'
        '<body name="hand">'
        f'<inertial pos="{_text(centre)}" mass="{HAND_MASS:.9g}" '
        f'diaginertia="{_text(HAND_INERTIA)}"/></body>'
    )


def _text(values: "Array | tuple[float, ...]") -> str:
    return " ".join(f"{float(v) + 0.0:.9g}" for v in values)
