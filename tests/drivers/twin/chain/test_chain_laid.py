"""A chain after its layers have met: laid down, and let go."""

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.engine import Touch
from drivers.strip.file import paper_strip
from drivers.twin.chain.engine import Chain
from policies.path import Path, triangular
from tests.support.chain_moves import SPEED, H, settle


class Laid:
    """A strip folded along the triangle, laid down about its touch, then let go."""

    def __init__(self, links: int, length: float) -> None:
        self.model = describe(paper_strip(0.1, 0.005, length=length))
        self.chain = Chain(links)
        self.chain.reset([self.model])
        self.touch, pose = self._fold(triangular(length))
        pose = self._lay(pose)
        self.held = settle(self.chain, pose, 0.5)
        self.chain.release()
        self.released = settle(self.chain, pose, 1.5)

    def _fold(self, path: Path) -> tuple[Touch, Array]:
        for pose in path.poses(np.arange(H, path.length / SPEED, H) * SPEED):
            touch = self.chain.step(pose[None], H).touch[0]
            if touch is not None:
                return touch, pose
        raise AssertionError("the layers never met")

    def _lay(self, pose: Array) -> Array:
        """Lower the edge about the touch, along a circle that grows to the layer's
        length.
        """
        touch_gap = self.model.mechanics.touch_gap
        x, z = pose[:2] - (self.touch.x, touch_gap)
        start, radius = np.arctan2(z, x), np.hypot(x, z)
        for share in np.linspace(0.0, 1.0, 600):
            angle = start + share * (np.pi - start)
            reach = radius + share * (self.touch.to_grasped - radius)
            place = reach * np.array([np.cos(angle), np.sin(angle)])
            place += (self.touch.x, touch_gap)
            pose = np.array([*place, np.pi / 2 * (1 + share)])
            self.chain.step(pose[None], H)
        return pose


@pytest.fixture(scope="module")
def laid() -> Laid:
    return Laid(links=80, length=0.4)


def test_fold_at_rest_is_as_high_as_the_heavy_elastica(laid: Laid) -> None:
    c = (0.1 * 0.002 / (1.65 * 9.81)) ** (1 / 3)
    assert laid.released[:, 1].max() == pytest.approx(0.9066 * c, rel=0.03)


def test_edge_is_laid_off_by_the_displacement(laid: Laid) -> None:
    offset = laid.released[0, 0] - laid.released[-1, 0]
    assert offset == pytest.approx(laid.touch.displacement, abs=1e-3)
