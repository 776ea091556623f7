"""Settings of the emulated robot that a client may change: thresholds, impedances,
tool, load.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from drivers.base.types import Array, frozen
from drivers.franka.kinematics import FLANGE_TO_TIP
from drivers.franka.model import HAND_CENTRE, HAND_MASS
from drivers.twin.fci_server.wire import Command, Status, usable

JOINT_STIFFNESS = (0.0, 14250.0)  # N m/rad
TRANSLATION_STIFFNESS = (10.0, 3000.0)  # N/m
ROTATION_STIFFNESS = (1.0, 300.0)  # N m/rad
LARGEST_LOAD = 3.0  # kg, the payload that the maker states
RIGID_TOLERANCE = 1e-5
_UNIT = frozen(np.eye(3))
_LAST_ROW = frozen([0, 0, 0, 1])


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Thresholds of external torque and force: first row for contact, second row for
    collision.

    The state reports a contact; a collision triggers a reflex. `accelerating` holds
    while the commanded velocity changes, `nominal` otherwise: (2, 7) [N m] at the
    joints, (2, 6) [N, N m] at the tool.
    """

    torque_accelerating: Array
    torque_nominal: Array
    force_accelerating: Array
    force_nominal: Array


def _start_thresholds() -> Thresholds:
    """Thresholds before a client sets others; assumed, as a robot's defaults are not
    published.
    """
    torque = frozen(np.full((2, 7), 20.0))
    force = frozen(np.full((2, 6), 20.0))
    return Thresholds(
        torque_accelerating=torque,
        torque_nominal=torque,
        force_accelerating=force,
        force_nominal=force,
    )


@dataclass(frozen=True, slots=True)
class Configuration:
    """Settings of the emulated robot that a client or Desk made; they outlast the
    client.
    """

    thresholds: Thresholds = field(default_factory=_start_thresholds)
    flange_to_nominal: Array = field(default_factory=lambda: FLANGE_TO_TIP)
    nominal_to_tool: Array = field(default_factory=lambda: frozen(np.eye(4)))
    tool_to_stiffness: Array = field(default_factory=lambda: frozen(np.eye(4)))
    hand_mass: float = HAND_MASS  # kg, Franka Hand, as set in Desk
    # m in the flange
    hand_centre: Array = field(default_factory=lambda: frozen(HAND_CENTRE))
    load_mass: float = 0.0  # kg
    # m in the flange
    load_centre: Array = field(default_factory=lambda: frozen(np.zeros(3)))
    load_inertia: Array = field(default_factory=lambda: frozen(np.zeros(9)))  # kg m^2

    @property
    def tool(self) -> Array:
        """Pose (4, 4) [m] of the end effector in the flange's frame."""
        return frozen(self.flange_to_nominal @ self.nominal_to_tool)


def configure(
    configuration: Configuration, command: Command, payload: bytes
) -> tuple[Configuration, Status]:
    """Configuration changed by a client's request `command`, and the status of the
    reply.
    """
    if command == Command.SET_GUIDING_MODE:
        allowed = all(flag in (0, 1) for flag in payload)
        return configuration, Status.SUCCESS if allowed else Status.INVALID_ARGUMENT
    numbers = np.frombuffer(payload, "<f8").astype(np.float64)
    changed = _SETTERS[command](configuration, numbers) if usable(numbers) else None
    if changed is None:
        return configuration, Status.INVALID_ARGUMENT
    return changed, Status.SUCCESS


def rigid(matrix: Array) -> bool:
    """Whether a matrix (4, 4) is a rigid transform: a rotation and a translation."""
    turn = matrix[:3, :3]
    return bool(
        np.linalg.det(turn) > 0  # right-handed
        and np.abs(turn @ turn.T - _UNIT).max() < RIGID_TOLERANCE
        and np.abs(matrix[3] - _LAST_ROW).max() < RIGID_TOLERANCE
    )


def _collision(old: Configuration, numbers: Array) -> Configuration | None:
    """Copy of `old` with the collision thresholds `numbers` (52,); None if one is
    negative or a lower one exceeds its upper.
    """
    joints = numbers[:28].reshape(4, 7)
    tool = numbers[28:].reshape(4, 6)
    pairs = [frozen(rows) for rows in (joints[:2], joints[2:], tool[:2], tool[2:])]
    if any((pair < 0).any() or (pair[0] > pair[1]).any() for pair in pairs):
        return None
    return replace(old, thresholds=Thresholds(*pairs))


def _joint_impedance(old: Configuration, numbers: Array) -> Configuration | None:
    return old if _within(numbers, JOINT_STIFFNESS) else None


def _cartesian_impedance(old: Configuration, numbers: Array) -> Configuration | None:
    fits = _within(numbers[:3], TRANSLATION_STIFFNESS) and _within(
        numbers[3:], ROTATION_STIFFNESS
    )
    return old if fits else None


def _within(numbers: Array, span: tuple[float, float]) -> bool:
    return bool((numbers >= span[0]).all() and (numbers <= span[1]).all())


def _frame(name: str, old: Configuration, numbers: Array) -> Configuration | None:
    """Copy of `old` with the column-major matrix (16,) as its frame `name`; None if not
    rigid.
    """
    matrix = numbers.reshape(4, 4).T
    changes: dict[str, Any] = {name: frozen(matrix)}
    return replace(old, **changes) if rigid(matrix) else None


def _load(old: Configuration, numbers: Array) -> Configuration | None:
    """Copy of `old` with the load's mass, centre and inertia in `numbers` (13,); None
    if these are impossible.
    """
    mass = float(numbers[0])
    centre = numbers[1:4]
    inertia = numbers[4:].reshape(3, 3)
    if (
        not 0 <= mass <= LARGEST_LOAD
        or np.abs(inertia - inertia.T).max() > RIGID_TOLERANCE
    ):
        return None
    if np.linalg.eigvalsh(inertia)[0] < 0:
        return None
    return replace(
        old,
        load_mass=mass,
        load_centre=frozen(centre),
        load_inertia=frozen(numbers[4:]),
    )


_SETTERS: dict[Command, Callable[[Configuration, Array], Configuration | None]] = {
    Command.SET_COLLISION_BEHAVIOR: _collision,
    Command.SET_JOINT_IMPEDANCE: _joint_impedance,
    Command.SET_CARTESIAN_IMPEDANCE: _cartesian_impedance,
    Command.SET_EE_TO_K: partial(_frame, "tool_to_stiffness"),
    Command.SET_NE_TO_EE: partial(_frame, "nominal_to_tool"),
    Command.SET_LOAD: _load,
}
SETTERS = frozenset((*_SETTERS, Command.SET_GUIDING_MODE))
