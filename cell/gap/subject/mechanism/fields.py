"""Fields of a MuJoCo model by name, edited in place: of one model, or of one in a batch."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from drivers.types import Array

OPTION = "opt."  # prefix of the names of fields that are options of a model


class ModelFields:
    """Fields of one model, edited in place; `finish` writes edited scalar options back."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self._numbers: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name`, to be edited in place."""
        if not name.startswith(OPTION):
            found: Array = getattr(self.model, name)
            return found
        value = getattr(self.model.opt, name.removeprefix(OPTION))
        if isinstance(value, np.ndarray):
            return value
        return self._numbers.setdefault(name, np.array(float(value)))

    def finish(self) -> None:
        """Write edited scalar options into the model."""
        for name, value in self._numbers.items():
            setattr(self.model.opt, name.removeprefix(OPTION), float(value))


class BatchFields:
    """Fields of simulation `i` of a batch; the first edit of a field copies it per simulation."""

    def __init__(self, expand: Callable[[str], Array], i: int) -> None:
        self._expand, self._i = expand, i

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name` for this simulation."""
        found: Array = self._expand(name)[self._i, ...]
        return found


Fields = ModelFields | BatchFields
"""Arrays of a model by MuJoCo's names (`dof_damping`, `opt.gravity`), to be edited in place."""


def scale_gain(fields: Fields, actuator: int, factor: float) -> None:
    """Multiply an actuator's gain and bias by a `factor`."""
    fields["actuator_gainprm"][actuator, :3] *= factor
    fields["actuator_biasprm"][actuator, :3] *= factor


def add_point(fields: Fields, body: int, mass: float, place: Array) -> None:
    """Add a point `mass` [kg] at `place` (3,) of the body's frame [m] to its mass and inertia."""
    stated, com = float(fields["body_mass"][body]), np.array(fields["body_ipos"][body])
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.array(fields["body_iquat"][body]))
    axes = rotation.reshape(3, 3)
    inertia = axes @ np.diag(fields["body_inertia"][body]) @ axes.T
    offset = np.asarray(place) - com
    reduced = stated * mass / (stated + mass)  # parallel axes, about the common centre of mass
    inertia += reduced * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    values, vectors = np.linalg.eigh(inertia)
    if np.linalg.det(vectors) < 0.0:  # a quaternion holds right-handed axes only
        vectors[:, 0] *= -1.0
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, vectors.ravel())
    fields["body_mass"][body] = stated + mass
    fields["body_ipos"][body] = com + offset * mass / (stated + mass)
    fields["body_iquat"][body] = quat
    fields["body_inertia"][body] = values
