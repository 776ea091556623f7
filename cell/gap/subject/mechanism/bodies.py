"""Edits mass properties of bodies."""

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effect import Fields
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def tip(mechanism: Mechanism, body: int) -> Array:
    """Position (3,) [m] of a body's farthest site in its frame, else twice its centre of mass."""
    model = mechanism.model
    places = [model.site_pos[i] for i in range(model.nsite) if model.site_bodyid[i] == body]
    places.append(2.0 * model.body_ipos[body])
    return np.array(max(places, key=lambda p: float(np.linalg.norm(p))))


def add_point(fields: Fields, body: int, mass: float, place: Array) -> None:
    """Add a point `mass` [kg] at `place` (3,) of the body's frame [m] to its mass and inertia."""
    had, com = float(fields["body_mass"][body]), np.array(fields["body_ipos"][body])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.array(fields["body_iquat"][body]))
    axes = turn.reshape(3, 3)
    whole = axes @ np.diag(fields["body_inertia"][body]) @ axes.T
    apart = np.asarray(place) - com
    reduced = had * mass / (had + mass)
    whole += reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    values, vectors = np.linalg.eigh(whole)
    if np.linalg.det(vectors) < 0.0:
        vectors[:, 0] *= -1.0
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, vectors.ravel())
    fields["body_mass"][body] = had + mass
    fields["body_ipos"][body] = com + apart * mass / (had + mass)
    fields["body_iquat"][body] = quat
    fields["body_inertia"][body] = values
