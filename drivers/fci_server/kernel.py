"""One tick of a Cartesian motion, compiled: kinematics, differential inverse, and its limits.

A posture is one vector; `POSTURE_FIELDS` names its parts. The formulas are those of
`drivers.franka`, for single postures; the tests compare the two.
"""

from enum import IntEnum
from itertools import accumulate, pairwise
from math import atan2, cos, sin, sqrt

import numpy as np

from drivers.fci_server.limits import TICK
from drivers.strip.rod.compiled import entry, kernel
from drivers.types import Array

_SIZES = {
    "q": 7,  # rad
    "velocity": 7,  # rad/s
    "acceleration": 7,  # rad/s^2
    "reached": 16,  # tool in the base, row by row
    "jacobian": 42,  # row by row
    "pose": 16,  # commanded, row by row
    "twist": 6,  # m/s, rad/s
    "change": 6,  # m/s^2, rad/s^2
    "elbow": 3,  # rad, rad/s, rad/s^2
    "sign": 1,  # of the elbow
}
_ENDS = list(accumulate(_SIZES.values(), initial=0))
POSTURE_FIELDS = {name: slice(*span) for name, span in zip(_SIZES, pairwise(_ENDS), strict=True)}
POSTURE_SIZE = _ENDS[-1]
Q, VELOCITY, ACCELERATION, REACHED, JACOBIAN, POSE, TWIST, CHANGE, ELBOW, SIGN = (
    part.start for part in POSTURE_FIELDS.values()
)

# Rows of the table of numbers that the compiled code is given, see `limits.TABLE`.
A, D, COS, SIN, LOW, HIGH, FASTEST, SHARPEST, JERK, OFFSET, BRAKING, TOOL, OTHER = range(13)


class Broken(IntEnum):
    """Which limit a command breaks, in the order in which they are checked."""

    NOTHING = 0
    TOOL_VELOCITY = 1
    TOOL_ACCELERATION = 2
    TOOL_JERK = 3
    ELBOW = 4
    JOINT_VELOCITY = 5
    JOINT_ACCELERATION = 6
    JOINT_JERK = 7
    JOINT_POSITION = 8
    JOINT_BRAKING = 9


@kernel
def _place(new: Array, last: Array, table: Array) -> None:
    """Pose and Jacobian of the joints in `new`, as `drivers.franka.kinematics` has them."""
    turn, place = np.eye(3), np.zeros(3)
    axes, origins = np.empty((7, 3)), np.empty((7, 3))
    local = np.empty((3, 3))
    for j in range(7):
        a, d, ca, sa = table[A, j], table[D, j], table[COS, j], table[SIN, j]
        c, s = cos(new[Q + j]), sin(new[Q + j])
        for i in range(3):
            place[i] += turn[i, 0] * a - turn[i, 1] * sa * d + turn[i, 2] * ca * d
        local[0, 0], local[0, 1], local[0, 2] = c, -s, 0.0
        local[1, 0], local[1, 1], local[1, 2] = s * ca, c * ca, -sa
        local[2, 0], local[2, 1], local[2, 2] = s * sa, c * sa, ca
        turn = _product(turn, local)
        for i in range(3):
            axes[j, i], origins[j, i] = turn[i, 2], place[i]
    for i in range(3):
        for k in range(4):
            new[REACHED + 4 * i + k] = (
                turn[i, 0] * last[k] + turn[i, 1] * last[4 + k] + turn[i, 2] * last[8 + k]
            )
        new[REACHED + 4 * i + 3] += place[i]
        new[REACHED + 12 + i] = 0.0
    new[REACHED + 15] = 1.0
    for j in range(7):
        x = new[REACHED + 3] - origins[j, 0]
        y = new[REACHED + 7] - origins[j, 1]
        z = new[REACHED + 11] - origins[j, 2]
        u, v, w = axes[j, 0], axes[j, 1], axes[j, 2]
        new[JACOBIAN + j] = v * z - w * y
        new[JACOBIAN + 7 + j] = w * x - u * z
        new[JACOBIAN + 14 + j] = u * y - v * x
        for i in range(3):
            new[JACOBIAN + 7 * (3 + i) + j] = axes[j, i]
    new[SIGN] = 1.0 if new[Q + 3] > table[OTHER, 5] else -1.0


@kernel
def _product(a: Array, b: Array) -> Array:
    c = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            c[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]
    return c


@kernel
def _rotation_between(start: Array, at: int, end: Array, to: int) -> tuple[float, float, float]:
    """Rotation vector [rad] from the pose at `start[at]` to that at `end[to]`, both (16,)."""
    turn = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            turn[i, k] = 0.0
            for m in range(3):
                turn[i, k] += end[to + 4 * i + m] * start[at + 4 * k + m]
    x, y, z = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    sine = sqrt(x * x + y * y + z * z) / 2
    cosine = (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1) / 2
    if sine < 1e-6 and cosine > 0:
        return x / 2, y / 2, z / 2
    if sine < 1e-6:
        return np.pi, 0.0, 0.0  # half a turn, about whatever axis
    scale = atan2(sine, cosine) / (2 * sine)
    return scale * x, scale * y, scale * z


@kernel
def _advance_pose(old: Array, twist: Array, new: Array) -> None:
    """The commanded pose of `new`, one tick of `twist` (6,) after that of `old` (Rodrigues)."""
    x, y, z = TICK * twist[3], TICK * twist[4], TICK * twist[5]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = sqrt(x * x + y * y + z * z)
    first = 1.0 if angle < 1e-9 else sin(angle) / angle
    second = 0.0 if angle < 1e-9 else (1 - cos(angle)) / angle**2
    square = _product(cross, cross)
    for i in range(3):
        for k in range(3):
            total = old[POSE + 4 * i + k]
            for m in range(3):
                part = first * cross[i, m] + second * square[i, m]
                total += part * old[POSE + 4 * m + k]
            new[POSE + 4 * i + k] = total
        new[POSE + 4 * i + 3] = old[POSE + 4 * i + 3] + TICK * twist[i]
        new[POSE + 12 + i] = 0.0
    new[POSE + 15] = 1.0


@kernel
def _rates(old: Array, wanted: Array, damping: float, new: Array) -> None:
    """Joint velocities of `new`, the damped inverse of the Jacobian of `old` with the elbow's row.

    `wanted` (7,) is the step of the tool and of the elbow; Cholesky's decomposition.
    """
    rows = np.zeros((7, 7))
    for i in range(6):
        for j in range(7):
            rows[i, j] = old[JACOBIAN + 7 * i + j]
    rows[6, 2] = 1.0
    lower = np.zeros((7, 7))
    y = np.empty(7)
    for i in range(7):
        for k in range(i + 1):
            total = damping**2 if i == k else 0.0
            for j in range(7):
                total += rows[i, j] * rows[k, j]
            for m in range(k):
                total -= lower[i, m] * lower[k, m]
            lower[i, k] = sqrt(total) if i == k else total / lower[k, k]
        y[i] = wanted[i]
        for m in range(i):
            y[i] -= lower[i, m] * y[m]
        y[i] /= lower[i, i]
    for i in range(6, -1, -1):
        for m in range(i + 1, 7):
            y[i] -= lower[m, i] * y[m]
        y[i] /= lower[i, i]
    for j in range(7):
        total = 0.0
        for i in range(7):
            total += rows[i, j] * y[i]
        new[VELOCITY + j] = total / TICK


@kernel
def _tool_broken(old: Array, new: Array, table: Array) -> int:
    """The limit of tool or elbow that `new` breaks, velocity before acceleration before jerk."""
    slack = table[OTHER, 4]
    rates = np.empty((3, 6))
    for i in range(6):
        rates[0, i], rates[1, i] = new[TWIST + i], new[CHANGE + i]
        rates[2, i] = (new[CHANGE + i] - old[CHANGE + i]) / TICK
    for k in range(3):
        moves = sqrt(rates[k, 0] ** 2 + rates[k, 1] ** 2 + rates[k, 2] ** 2)
        turns = sqrt(rates[k, 3] ** 2 + rates[k, 4] ** 2 + rates[k, 5] ** 2)
        if moves > slack * table[TOOL, k] or turns > slack * table[TOOL, 3 + k]:
            return 1 + k
    swing = (new[ELBOW + 1], new[ELBOW + 2], (new[ELBOW + 2] - old[ELBOW + 2]) / TICK)
    for k in range(3):
        if abs(swing[k]) > slack * table[OTHER, k]:
            return 4
    return 0


@kernel
def _joints_broken(old: Array, new: Array, table: Array) -> int:
    """The limit of a joint that `new` breaks."""
    slack = table[OTHER, 4]
    for k in range(3):
        for j in range(7):
            value = new[VELOCITY + j] if k == 0 else new[ACCELERATION + j]
            most = slack * table[FASTEST + k, j]
            if k == 2:  # as change of the acceleration in one tick
                value, most = value - old[ACCELERATION + j], TICK * most
            if abs(value) > most:
                return 5 + k
    for j in range(7):
        if min(new[Q + j] - table[LOW, j], table[HIGH, j] - new[Q + j]) < 0:
            return 8
    one_tick = slack * TICK * table[SHARPEST].max()
    for j in range(7):
        up = _braking_limit(table[HIGH, j] - new[Q + j], j, table)
        down = _braking_limit(new[Q + j] - table[LOW, j], j, table)
        if min(new[VELOCITY + j] + down, up - new[VELOCITY + j]) < -one_tick:
            return 9
    return 0


@kernel
def _braking_limit(room: float, j: int, table: Array) -> float:
    """Largest velocity [rad/s] of joint `j` with so much `room` [rad] before its end."""
    speed = sqrt(2 * table[BRAKING, j] * room) - table[OFFSET, j]
    return float(min(max(speed, 0.0), table[FASTEST, j]))


@entry
def place(new: Array, last: Array, table: Array) -> None:
    """Write pose, Jacobian and the elbow's sign of the joints of posture `new` (POSTURE_SIZE,).

    `last` (16,) is the tool in the last joint's frame, row by row.
    """
    _place(new, last, table)


@entry
def advance(
    old: Array, target: Array, by_twist: bool, last: Array, table: Array, new: Array
) -> int:
    """One tick from posture `old` (POSTURE_SIZE,) to `new`; returns a number of `Broken`.

    `target` (23,) is the commanded pose row by row, the twist, and the elbow [rad]; `by_twist` says
    which of the first two counts. `last` (16,) is the tool in the last joint's frame.
    """
    new[:] = old
    if by_twist:
        new[TWIST : TWIST + 6] = target[16:22]
        _advance_pose(old, target[16:22], new)
    else:
        new[POSE : POSE + 16] = target[:16]
        turn = _rotation_between(old, POSE, target, 0)
        for i in range(3):
            new[TWIST + i] = (target[4 * i + 3] - old[POSE + 4 * i + 3]) / TICK
            new[TWIST + 3 + i] = turn[i] / TICK
    for i in range(6):
        new[CHANGE + i] = (new[TWIST + i] - old[TWIST + i]) / TICK
    new[ELBOW] = target[22]
    new[ELBOW + 1] = (target[22] - old[ELBOW]) / TICK
    new[ELBOW + 2] = (new[ELBOW + 1] - old[ELBOW + 1]) / TICK
    broken = _tool_broken(old, new, table)
    if broken:
        return broken
    wanted = np.empty(7)
    turn = _rotation_between(old, REACHED, new, POSE)
    for i in range(3):
        wanted[i] = new[POSE + 4 * i + 3] - old[REACHED + 4 * i + 3]
        wanted[3 + i] = turn[i]
    wanted[6] = target[22] - old[Q + 2]
    _rates(old, wanted, table[OTHER, 3], new)
    for j in range(7):
        new[Q + j] = old[Q + j] + TICK * new[VELOCITY + j]
        new[ACCELERATION + j] = (new[VELOCITY + j] - old[VELOCITY + j]) / TICK
    broken = _joints_broken(old, new, table)
    if broken:
        return broken
    _place(new, last, table)
    return 0
