"""Motions of chains that several tests make."""

import numpy as np

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.engine import StripMotion
from drivers.strip.file import StripFile, paper_damping_minimum, paper_strip
from drivers.twin.chain.engine import Chain
from policies.path import Path
from tests.support.effect_cases import simulate

H = 0.005  # s
SPEED = 0.1  # m/s
LENGTH = 0.6  # m


def middling(**changes: object) -> StripFile:
    """Strip in the middle of the paper's parameter range."""
    return paper_strip(0.0775, 7 * paper_damping_minimum(0.0775)).model_copy(
        update=changes
    )


def fold(strip: StripFile, path: Path, links: int = 60, dt: float = H) -> StripMotion:
    """Simulated fold of a chain along `path` at 0.1 m/s, up to the layers' touch."""
    t = np.arange(0.0, path.length / SPEED, H)
    motion = simulate(Chain(links), describe(strip), t, path.poses(t * SPEED), dt=dt)
    assert motion.touch is not None
    return motion


def displacement(motion: StripMotion) -> float:
    """Displacement d [m] at the layers' touch of a motion."""
    return motion.touch.displacement


def carry(chain: Chain, travel: float, path: Path) -> Array:
    """Move the gripper along `path` to `travel` [m]; returns the pose (3,) there."""
    poses = path.poses(np.arange(H, travel / SPEED, H) * SPEED)
    for pose in poses:
        chain.step(pose[None], H)
    return np.asarray(poses[-1])


def settle(chain: Chain, pose: Array, seconds: float) -> Array:
    """Step with the gripper at rest for `seconds`; returns the final midline (nodes, 2)
    [m].
    """
    for _ in range(round(seconds / H)):
        chain.step(pose[None], H)
    return chain.shapes()[0]
