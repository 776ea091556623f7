"""External forces at the emulated tool, and the collision check."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.fci_server.configuration import Configuration
from drivers.fci_server.posture import Posture
from drivers.fci_server.reflex import Reflex
from drivers.types import Array

STEADY_ACCELERATION = 1e-3  # rad/s^2 and m/s^2, below which a motion counts as uniform


@dataclass(frozen=True, slots=True)
class Contact:
    """Estimated wrench (6,) [N, N m] on the tool in the base, and the joint torques it causes.

    Flags are 1 where a threshold is passed: first row contact, second collision.
    """

    wrench: Array
    torque: Array  # (7,) N m
    joint_flags: Array  # (2, 7)
    tool_flags: Array  # (2, 6)

    @classmethod
    def of_force(cls, posture: Posture, configuration: Configuration, force: Array) -> Self:
        """Contact that a `force` (3,) [N] on the tool's origin causes in `posture`."""
        wrench = np.zeros(6)
        wrench[:3] = force
        lever = posture.reached[:3, :3] @ configuration.tool_to_stiffness[:3, 3]
        wrench[3:] = np.cross(-lever, force)
        torque = posture.jacobian[:3].T @ force
        thresholds = configuration.thresholds
        steady = bool((np.abs(posture.joints.acceleration) < STEADY_ACCELERATION).all())
        joints = thresholds.torque_nominal if steady else thresholds.torque_accelerating
        tool = thresholds.force_nominal if steady else thresholds.force_accelerating
        joint_flags = np.greater(np.abs(torque), joints).astype(np.float64)
        tool_flags = np.greater(np.abs(wrench), tool).astype(np.float64)
        return cls(wrench, torque, joint_flags, tool_flags)

    @property
    def reflex(self) -> Reflex | None:
        """Reflex that a threshold of collision triggers; None where none is passed."""
        if self.tool_flags[1].any():
            return Reflex.CARTESIAN_REFLEX
        return Reflex.JOINT_REFLEX if self.joint_flags[1].any() else None


NO_CONTACT = Contact(np.zeros(6), np.zeros(7), np.zeros((2, 7)), np.zeros((2, 6)))
