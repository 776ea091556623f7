"""Turns that a strip has when nothing bends it."""

from dataclasses import replace

import numpy as np

from drivers.strip.file import GRAVITY
from drivers.strip.model import StripModel
from drivers.types import frozen

REACH = 0.005  # m to each side over which a crease turns
SET = 1.2  # bending lengths before the grip: where its first turn bends a strip that lies


def creased(model: StripModel, angle: float, position: float) -> StripModel:
    """The model of a strip that has turned by `angle` [rad] at `position` [m]."""
    mechanics = model.mechanics
    away = np.abs(mechanics.cells - position)
    near = mechanics.inside(position, 2 * REACH) * np.clip(1.0 - away / REACH, 0.0, 1.0)
    curvature = angle * near / mechanics.total(near, mechanics.ends)
    curved = frozen(mechanics.rest_curvature + curvature)
    return replace(model, mechanics=replace(mechanics, rest_curvature=curved))


def set_down(model: StripModel, turn: float) -> StripModel:
    """The model of a strip that stays turned down by `turn` [rad] before the grip.

    The gripper turns, and pushes what lies, before anything is lifted. Where the strip bends then
    hangs on a hair's breadth of slack, and what a strip with a memory keeps of it on all that
    came before.
    """
    mechanics = model.mechanics
    weight = float(np.mean(mechanics.linear_density)) * GRAVITY
    bending_length = (float(np.mean(mechanics.rigidity)) / weight) ** (1 / 3)
    return creased(model, -turn, mechanics.length - SET * bending_length) if turn else model
