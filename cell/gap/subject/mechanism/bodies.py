"""Edits the mass properties of bodies in a model."""

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effect import Fields
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def tip(mechanism: Mechanism, body: int) -> Array:
    """Position (3,) [m] in a body's frame of its end: farthest site or twice the centre of mass."""
    model = mechanism.model
    places = [model.site_pos[i] for i in range(model.nsite) if model.site_bodyid[i] == body]
    places.append(2.0 * model.body_ipos[body])
    return np.array(max(places, key=lambda p: float(np.linalg.norm(p))))


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
