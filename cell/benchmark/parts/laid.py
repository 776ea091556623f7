"""Benchmark part: a strip folded, laid down and released, whose height the paper calls h."""

from dataclasses import dataclass

import numpy as np

from cell.benchmark.parts.evolution import curve
from cell.benchmark.results import Laid
from drivers.errors import CellError
from drivers.strip.describe import describe
from drivers.strip.shape import Touch
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.domain import strip_at
from policies.path import Path
from policies.planned import plan, raise_path

STEP = 0.005  # s
LINKS = 120
SPEED, LAY_SPEED = 0.1, 0.05  # m/s
DAMPING_SHARE = 0.3  # place in the paper's range
HELD, RELEASED = 0.5, 1.5  # s of rest


@dataclass(frozen=True, slots=True)
class LaidDown:
    """Benchmark part: a laid strip at `stiffness`, its place in the paper's range from 0 to 1."""

    stiffness: float
    of: str
    cost: float = 8.0

    @property
    def key(self) -> str:
        """Key with all parameters of the part."""
        return f"laid strip at {self.stiffness:.3g} on {LINKS} links"

    def measure(self) -> Laid:
        """Fold on the planned path, lay the edge on the fixed one, release it, return the shape."""
        strip = strip_at(self.stiffness, DAMPING_SHARE)
        chain = Chain(LINKS)
        chain.reset([describe(strip)])
        path = raise_path(strip.length, float(plan([strip], SPEED)[0]))
        touch, pose = _fold_and_lay(chain, path)
        end = np.array([touch.x - touch.to_grasped, strip.thickness, np.pi])
        steps = round(float(np.hypot(*(end - pose)[:2])) / LAY_SPEED / STEP)
        for share in np.linspace(0.0, 1.0, steps):
            chain.step((pose + share * (end - pose))[None], STEP)
        _hold_still(chain, end, HELD)
        chain.release()
        _hold_still(chain, end, RELEASED)
        return Laid(bending_length=strip.bending_length, shape=curve(chain.shapes()[0]))


def _fold_and_lay(chain: Chain, path: Path) -> tuple[Touch, Array]:
    for pose in path.poses(np.arange(STEP, path.length / SPEED, STEP) * SPEED):
        touch = chain.step(pose[None], STEP).touch[0]
        if touch is not None:
            return touch, pose
    raise CellError("the layers never met")


def _hold_still(chain: Chain, pose: Array, seconds: float) -> None:
    for _ in range(round(seconds / STEP)):
        chain.step(pose[None], STEP)
