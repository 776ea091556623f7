"""Joint coordinates of a chain of links, and the positions and speeds that they imply."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from drivers.types import Array

HINGE, SLIDE = "hinge", "slide"  # and the number of their node

Indices = NDArray[np.int_]


@dataclass(frozen=True, slots=True)
class Joints:
    """Indices of the joints of a chain of n links, whose lengths at rest are `spans` (n,) [m].

    `hinges` (n + 1,) are those of the nodes; `slides` those by which the links `lengthened` grow
    longer; `edge` moves the fixed edge along the desk, `grip` the end of the last link.
    """

    spans: Array
    hinges: Indices
    slides: Indices
    lengthened: Indices
    edge: int | None
    grip: int | None

    @classmethod
    def from_model(cls, model: mujoco.MjModel, spans: Array) -> Self:
        """Joint indices of a compiled chain."""
        links = len(spans)
        found = {model.joint(j).name: j for j in range(model.njnt)}
        slides = {k: found[f"{SLIDE}{k}"] for k in range(links + 1) if f"{SLIDE}{k}" in found}
        stretching = [node for node in slides if node > 0]
        return cls(
            spans=spans,
            hinges=np.array([found[f"{HINGE}{k}"] for k in range(links + 1)]),
            slides=np.array([slides[node] for node in stretching], dtype=int),
            lengthened=np.array(stretching, dtype=int) - 1,
            edge=slides.get(0),
            grip=slides.get(links),
        )

    def angles(self, position: Array) -> Array:
        """Angles (n + 1,) [rad] of links and tip from flat."""
        return np.asarray(position[self.hinges].cumsum())

    def nodes(self, position: Array) -> Array:
        """Positions (n + 1, 2) of the nodes: x, z [m]."""
        angles = self.angles(position)[:-1]
        nodes = np.zeros((len(self.hinges), 2))
        nodes[1:, 0] = np.cos(angles)
        nodes[1:, 1] = np.sin(angles)
        nodes[1:] *= self._lengths(position)
        if self.edge is not None:
            nodes[0, 0] = position[self.edge]
        return np.asarray(nodes.cumsum(axis=0))

    def speeds(self, position: Array, rate: Array) -> tuple[Array, Array]:
        """Speeds (n, 2) [m/s] of link middles along and across the link, and directions (n, 2)."""
        angles = self.angles(position)[:-1]
        along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
        turn = rate[self.hinges].cumsum()[:-1, None] * self._lengths(position) * normals
        growth = np.zeros((len(angles), 1))
        growth[self.lengthened, 0] = rate[self.slides]
        ends = (turn + growth * along).cumsum(axis=0)
        middles = ends - 0.5 * turn
        if self.edge is not None:
            middles[:, 0] += rate[self.edge]
        speeds = [(middles * direction).sum(axis=1) for direction in (along, normals)]
        return np.stack(speeds, axis=1), along

    def _lengths(self, position: Array) -> Array:
        lengths = self.spans[:, None].copy()
        lengths[self.lengthened, 0] += position[self.slides]
        return lengths
