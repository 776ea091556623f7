"""Creases: local rest angles of the strip."""

from dataclasses import replace

import numpy as np

from drivers.strip.file import GRAVITY
from drivers.strip.model import StripModel
from drivers.types import frozen

HALF_WIDTH = 0.005  # m to each side over which a crease turns
GRASP_BEND = 1.2  # bending lengths from the grip to where its first turn bends a lying strip


def add_crease(model: StripModel, angle: float, position: float) -> StripModel:
    """The model with a crease: a rest angle `angle` [rad] at `position` [m]."""
    mechanics = model.mechanics
    away = np.abs(mechanics.cells - position)
    near = mechanics.inside(position, 2 * HALF_WIDTH) * np.clip(1.0 - away / HALF_WIDTH, 0.0, 1.0)
    curvature = angle * near / mechanics.total(near, mechanics.ends)
    curved = frozen(mechanics.rest_curvature + curvature)
    return replace(model, mechanics=replace(mechanics, rest_curvature=curved))


def add_grasp_crease(model: StripModel, turn: float) -> StripModel:
    """The model with a crease of `turn` [rad] in front of the grip, as left by the grasp.

    The grasp turns and pushes the lying strip before anything is lifted. Where it bends then
    depends on unknown slack, and the crease that a strip with bending hysteresis keeps depends on
    its history; so the crease is a parameter.
    """
    if not turn:
        return model
    mechanics = model.mechanics
    weight = float(np.mean(mechanics.linear_density)) * GRAVITY
    bending_length = (float(np.mean(mechanics.rigidity)) / weight) ** (1 / 3)
    return add_crease(model, -turn, mechanics.length - GRASP_BEND * bending_length)
