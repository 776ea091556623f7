"""The midline as a smooth curve, with its motion during an exposure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.twin.renderer.kernels import interpolate
from drivers.twin.scene import Scene
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Curve:
    """The midline at arc lengths `s` (m,): `points`, unit `tangents` (m, 2) [m].

    `motion` (m, 2) [m] is how far the points move during the exposure, None for a strip at rest.
    """

    s: Array
    points: Array
    tangents: Array
    motion: Array | None

    @property
    def steps(self) -> Array:
        """Displacements (m, 2) [m] along the curve, as long as the spacing of the samples."""
        return np.asarray(self.tangents * (self.s[1] - self.s[0]))

    @property
    def normals(self) -> Array:
        """Unit normals (m, 2), to the left of the tangent: up for a strip lying along +x."""
        return np.stack([-self.tangents[:, 1], self.tangents[:, 0]], axis=-1)


def expose(scenes: Sequence[Scene], spacing: float) -> Curve:
    """The midline sampled about every `spacing` [m] during an exposure.

    The scenes are at the middles of equal parts of the exposure; the middle one gives the shape,
    the first and the last the motion, which is assumed uniform.
    """
    first, middle, last = scenes[0], scenes[len(scenes) // 2], scenes[-1]
    length = float(middle.arc[-1])
    count = max(int(np.ceil(length / spacing)), 8)
    s = np.asarray((np.arange(count) + 0.5) * (length / count), dtype=np.float64)
    points, derivatives = through_nodes(smooth(middle.points, middle.arc), middle.arc, s)
    size = np.sqrt(derivatives[:, 0] ** 2 + derivatives[:, 1] ** 2)
    motion = None
    if first.points is not last.points:
        shift = (last.points - first.points) * (len(scenes) / (len(scenes) - 1))
        motion = np.stack([np.interp(s, middle.arc, shift[:, j]) for j in range(2)], axis=-1)
    return Curve(s, points, derivatives / size[:, None], motion)


def smooth(points: Array, arc: Array) -> Array:
    """Nodes (n, 2) whose smooth curve is nearest to the straight links between `points`.

    A curve through the ends of straight links lies outside them by kappa h^2 / 12 on average.
    Moving the nodes in by as much, a twelfth of their second difference where the links are equal,
    removes that bias, so that contact and profile measured along the links are those of the
    picture.
    """
    spans = np.diff(arc)
    bend = np.diff(np.diff(points, axis=0) / spans[:, None], axis=0)
    nodes = points.copy()
    nodes[1:-1] += bend * (spans[:-1] * spans[1:] / (6 * (spans[:-1] + spans[1:])))[:, None]
    return nodes


def through_nodes(nodes: Array, arc: Array, s: Array) -> tuple[Array, Array]:
    """Points and derivatives (m, 2) at increasing `s` of a cubic Hermite curve through `nodes`.

    A node's slope is that of the parabola through it and its neighbours.
    """
    slopes = np.gradient(nodes, arc, axis=0, edge_order=2 if len(arc) > 2 else 1)
    return interpolate(nodes, np.ascontiguousarray(slopes), arc.copy(), s)
