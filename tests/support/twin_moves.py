"""Motions of a twin that several tests make."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from drivers.base.types import Pose, Velocity
from drivers.strip.describe import load_strip
from drivers.strip.engine import Observables
from drivers.twin.open import Twin, open_twin
from drivers.twin.settings import ArmSettings, CameraSettings, TwinSettings
from drivers.twin.world import World

DENIM = load_strip(Path(__file__).parents[2] / "configs" / "strips" / "denim.yaml")


class Steps:
    """Steps of a world's strip from now on: times, edge's poses, midlines and desk
    contacts.
    """

    def __init__(self, world: World) -> None:
        self._world, self._plant = world, world._plant
        self._rows: list[tuple[float, np.ndarray, np.ndarray, float]] = []
        world._plant = self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def step(self, poses: np.ndarray, dt: float) -> Observables:
        observed = self._plant.step(poses, dt)
        row = (self._world.time, poses[0].copy(), self._plant.shapes()[0].copy())
        self._rows.append((*row, float(observed.contact_x[0])))
        return observed

    def truth(self) -> SimpleNamespace:
        """Times (k,), edge's poses (k, 3), midlines (k, n, 2), contacts (k,), and the
        touch.
        """
        t, edge, shapes, contact_x = map(np.array, zip(*self._rows, strict=True))
        touch = self._world.touch
        return SimpleNamespace(
            t=t, edge=edge, shapes=shapes, contact_x=contact_x, touch=touch
        )


def wait(twin: Twin, seconds: float) -> None:
    """Advance the twin by `seconds`."""
    twin.clock.wait_until(twin.clock.now() + seconds)


def move(twin: Twin, pose: Pose) -> None:
    """Move to `pose` and wait until the arm rests there."""
    twin.arm.move_to(pose)
    while twin.arm.state().moving:
        wait(twin, 0.01)


def grasp(twin: Twin) -> None:
    """Grasp the strip at its stated edge."""
    hand = twin.hand
    move(twin, Pose(twin.model.stated_length, 0.0, 0.0))
    hand.grasp()
    while hand.state().moving:
        wait(twin, 0.01)
    assert hand.state().grasped


def drive(twin: Twin, velocity: Velocity, seconds: float) -> None:
    """Command `velocity` for `seconds`."""
    for _ in range(round(seconds / 0.01)):
        twin.arm.set_velocity(velocity)
        wait(twin, 0.01)


def lift(twin: Twin) -> None:
    """Drive the first 0.10 m of the triangle at 0.1 m/s, and the climb after it."""
    v = 0.1 / np.sqrt(2)
    drive(twin, Velocity(-v, v, np.pi / 2), 1.0)
    drive(twin, Velocity(-v, v, 0.0), 1.0)


def twin_with(seed: int = 0, **arm) -> Twin:
    camera = CameraSettings(width=320, height=240)
    twin = open_twin(TwinSettings(arm=ArmSettings(**arm), camera=camera), DENIM, seed)
    twin.arm.connect()
    return twin
