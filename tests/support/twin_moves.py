"""Motions of a twin that several tests make."""

from pathlib import Path

import numpy as np

from drivers.strip.describe import load_strip
from drivers.twin.open import Twin, open_twin
from drivers.twin.settings import ArmSettings, CameraSettings, TwinSettings
from drivers.types import Pose, Velocity

DENIM = load_strip(Path(__file__).parents[2] / "configs" / "strips" / "denim.yaml")


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
    move(twin, Pose(twin.model.stated_length, 0.0, 0.0))
    twin.hand.grasp()
    while twin.hand.state().moving:
        wait(twin, 0.01)
    assert twin.hand.state().grasped


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
    twin = open_twin(TwinSettings(arm=ArmSettings(**arm), camera=camera), DENIM, None, seed)
    twin.arm.connect()
    return twin
