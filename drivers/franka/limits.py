"""Limits of Franka arms: joints as a robot describes them, published ones, motion of
the hand and elbow.

Sources: franka_description (fr3 and fr3v2, joint_limits.yaml) for joints and torques,
the user documentation "Robot and interface specifications" and libfranka's
rate_limiting.h for rates. Never measured on a robot.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any, Literal, Self
from xml.etree import ElementTree

import numpy as np

from drivers.base.types import Array, frozen
from drivers.franka import kinematics
from drivers.franka.failure import ArmFault, Cause

Seven = tuple[float, ...]
Revision = Literal["fr3", "fr3v2"]

ACCELERATION = frozen([10.0] * 7)  # rad/s^2
JERK = frozen([5000.0] * 7)  # rad/s^3
LARGEST_TORQUE = frozen([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])  # N m

TRANSLATION = (3.0, 9.0, 4500.0)  # m/s, m/s^2, m/s^3
ROTATION = (2.5, 17.0, 8500.0)  # rad/s, rad/s^2, rad/s^3
ELBOW = (1.5, 10.0, 5000.0)  # rad/s, rad/s^2, rad/s^3

# name of a joint in a description, with the arm's
ARM_JOINT = re.compile(r"(?!.*finger)(?:(\w+)_)?joint([1-7])")
KNOWN_ARMS = (None, "fr3", "fr3v2")  # prefixes of joints; none in old descriptions
LIMIT, NEAR_END = "limit", "position_based_velocity_limits"  # elements of a joint
ATTRIBUTES = (
    (LIMIT, "lower"),
    (LIMIT, "upper"),
    (LIMIT, "velocity"),
    (NEAR_END, "velocity_offset"),
    (NEAR_END, "deceleration_limit"),
)


@dataclass(frozen=True)
class JointLimits:
    """Limits of an arm's joints, each (7,): `lower`, `upper` [rad], `velocity` [rad/s].

    Close to a joint's end its velocity is limited so that it can still brake: by
    `offset` [rad/s] and `deceleration` [rad/s^2].
    """

    lower: Seven
    upper: Seven
    velocity: Seven
    offset: Seven
    deceleration: Seven

    @classmethod
    def from_description(cls, description: str) -> Self:
        """Limits in a robot's URDF `description`.

        Raises ArmFault for another arm than a Franka Research 3, by its name, and for a
        joint without a limit.
        """
        joints = _arm_joints(description)
        columns = [
            tuple(_attribute(joints, number, *keys) for number in range(1, 8))
            for keys in ATTRIBUTES
        ]
        return cls(*columns)

    def content(self) -> dict[str, Any]:
        """Limits as plain values, for the record of a run."""
        return {
            "lower": list(self.lower),
            "upper": list(self.upper),
            "velocity": list(self.velocity),
            "velocity_offset": list(self.offset),
            "deceleration_limit": list(self.deceleration),
        }

    @cached_property
    def low(self) -> Array:
        """Lower ends (7,) [rad] of the joints' ranges."""
        return frozen(self.lower)

    @cached_property
    def high(self) -> Array:
        """Upper ends (7,) [rad] of the joints' ranges."""
        return frozen(self.upper)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Lower and upper ends of the joints' ranges, (7,) [rad] each."""
        return self.low, self.high

    @cached_property
    def middle(self) -> Array:
        """Joint angles (7,) [rad] in the middle of the joints' ranges."""
        return frozen((self.low + self.high) / 2)

    def margins(self, q: Array) -> Array:
        """Distance (..., 7) [rad] of joints `q` (..., 7) from their nearer end;
        negative beyond.

        User documentation, "limits depending on the joint position".
        """
        return np.minimum(q - self.low, self.high - q)

    def velocity_bounds(self, q: Array) -> tuple[Array, Array]:
        """Lowest and highest joint velocity (..., 7) [rad/s] allowed at joints `q`
        (..., 7) [rad].

        User documentation, "limits depending on the joint position".
        """
        return -self._braking_speed(q - self.low), self._braking_speed(self.high - q)

    def _braking_speed(self, room: Array) -> Array:
        """Speeds (..., 7) [rad/s] from which the joints can brake within angles `room`
        (..., 7) [rad].
        """
        braking = np.sqrt(2 * frozen(self.deceleration) * np.maximum(room, 0))
        speed = np.maximum(braking - self.offset, 0)
        bounded: Array = np.minimum(speed, self.velocity)
        return bounded


PUBLISHED: dict[Revision, JointLimits] = {
    revision: JointLimits(**{key: tuple(values) for key, values in stated.items()})
    for revision, stated in kinematics.PUBLISHED["joints"].items()
}
FR3, FR3V2 = PUBLISHED.values()


def _arm_joints(description: str) -> dict[int, ElementTree.Element]:
    """Elements of the arm's joints in a URDF `description`, by their numbers 1 to 7."""
    if "<!" in description.replace("<!--", ""):
        raise ArmFault(Cause.MODEL, "the robot's description holds a declaration")

    try:
        root = ElementTree.fromstring(description)  # noqa: S314  no entities: refused above
    except ElementTree.ParseError as error:
        words = f"the robot's description is no XML: {error}"
        raise ArmFault(Cause.MODEL, words) from None

    joints = dict(_named_joints(root))
    if not joints:
        words = f"the robot calls itself {root.get('name', 'nothing')!r}"
        raise ArmFault(Cause.MODEL, f"{words}; it describes no arm of seven joints")
    return joints


def _named_joints(
    root: ElementTree.Element,
) -> Iterator[tuple[int, ElementTree.Element]]:
    """Yield number and element of each joint of the arm; ArmFault for another make."""
    for joint in root.findall("joint"):
        name = ARM_JOINT.fullmatch(joint.get("name", ""))
        if name is None:
            continue
        if name[1] not in KNOWN_ARMS:
            words = f"the robot is a {name[1]!r}, by its joint {name[0]}"
            raise ArmFault(Cause.MODEL, words)
        yield int(name[2]), joint


def _attribute(
    joints: dict[int, ElementTree.Element], number: int, tag: str, name: str
) -> float:
    """Number in the attribute `name` of the element `tag` of joint `number` in a URDF;
    ArmFault without one.
    """
    joint = joints.get(number)
    element = None if joint is None else joint.find(tag)
    text = None if element is None else element.get(name)
    value = float("nan")
    with suppress(ValueError):
        value = float(text or "nan")
    if not isfinite(value):
        words = f"joint {number}: the robot's description states no number {name}"
        raise ArmFault(Cause.MODEL, words)
    return value
