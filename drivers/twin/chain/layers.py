"""The two layers of a folded chain, and their contact bodies."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from drivers.twin.chain.contact import solid
from drivers.twin.chain.lumps import Lumps
from drivers.types import Array

THICK = 0.005  # m, how far one layer may fall through the other and is still pushed back
LAYER_FRICTION = 1.0  # of fabric on fabric, assumed; more than on a desk (paper, III-A)
UPPER = 2  # collision class
FLAT = np.sqrt(0.5)  # cosine of the angle to the desk at which the bend between layers begins
CLING_REACH = 0.0005  # m, how far layers that cling may part before they let go


@dataclass(frozen=True, slots=True)
class Layers:
    """Links up to number `lower` form the lower layer, nodes from number `upper` the upper one.

    The bend between them belongs to neither: it never touches itself.
    """

    lower: int
    upper: int

    @classmethod
    def of(cls, angle: Array) -> Self:
        """The layers of a fold whose links stand at `angle` (n,) [rad] from flat."""
        level = np.cos(angle)
        turned = int(np.argmax(level < 0))
        flat = np.flatnonzero(level[:turned] > FLAT)
        back = np.flatnonzero(level[turned:] < -FLAT)
        return cls(
            lower=int(flat[-1]) if len(flat) else 0,
            upper=turned + int(back[0]) if len(back) else len(angle),
        )

    def add(self, body: mujoco.MjsBody, node: int, lumps: Lumps, gap: float) -> None:
        """Add to `body` the contact shape of the link that begins at `node`.

        It keeps midlines `gap` [m] apart, and together with adhesion. It lies on the outer side of
        the fold and is thick, because a falling layer moves by more than the thickness of fabric
        within a step.
        """
        link = min(node, len(lumps.spans) - 1)
        radius = max(THICK, gap)
        outside = 0.5 * gap - radius
        if node >= self.upper:
            bead = solid(body, contype=UPPER, conaffinity=0)
            bead.size = [radius, 0.0, 0.0]
            bead.pos = [0.0, 0.0, outside]
        elif node <= self.lower:
            bead = solid(body, contype=0, conaffinity=UPPER)
            bead.type = mujoco.mjtGeom.mjGEOM_CAPSULE
            bead.size = [radius, 0.0, 0.0]
            bead.fromto = [0.0, 0.0, outside, lumps.spans[link], 0.0, outside]
        else:
            return
        if lumps.cling[link] > 0:
            bead.adhesion, bead.gap = lumps.cling[link], CLING_REACH
        bead.condim = 3
        bead.friction = [LAYER_FRICTION, 0.0, 0.0]
