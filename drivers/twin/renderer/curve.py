"""The midline between its nodes: where the material is, at any arc length, during an exposure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.twin.scene import Scene
from drivers.types import Array

GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True)
class Curve:
    """Points of the midline: arc lengths `s` (m,), `points` and unit `tangents` (m, 2) [m]."""

    s: Array
    points: Array
    tangents: Array

    @property
    def steps(self) -> Array:
        """(m, 2) what each sample stands for: a piece of the curve as long as their spacing [m]."""
        return np.asarray(self.tangents * (self.s[1] - self.s[0]))

    @property
    def normals(self) -> Array:
        """(m, 2) unit normals, to the left of the tangent: up for a strip lying along +x."""
        return np.stack([-self.tangents[:, 1], self.tangents[:, 0]], axis=-1)


def through_nodes(points: Array, arc: Array, s: Array) -> tuple[Array, Array]:
    """Points and derivatives (m, 2) at `s` of the cubic Hermite curve through nodes (n, 2).

    A node's slope is that of the parabola through it and its neighbours.
    """
    slopes = np.gradient(points, arc, axis=0, edge_order=2 if len(arc) > 2 else 1)
    i = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(arc) - 2)
    h = (arc[i + 1] - arc[i])[:, None]
    t = ((s - arc[i]) / h[:, 0])[:, None]
    p0, p1, m0, m1 = points[i], points[i + 1], slopes[i], slopes[i + 1]
    chord = (p1 - p0) / h
    c2 = 3 * chord - 2 * m0 - m1
    c3 = m0 + m1 - 2 * chord
    return p0 + h * t * (m0 + t * (c2 + t * c3)), m0 + t * (2 * c2 + 3 * t * c3)


def midline(points: Array, arc: Array, s: Array) -> tuple[Array, Array]:
    """Points and derivatives (m, 2) at `s` of the smooth curve nearest to the links of a chain.

    A curve through the nodes of straight links stays on their outer side, by kappa h^2 / 12 on
    average. Nodes that move in by a twelfth of their second difference take that away, so that
    contact and profile measured along the links are those of the picture.
    """
    nodes = points.copy()
    nodes[1:-1] += (points[:-2] - 2 * points[1:-1] + points[2:]) / 12
    return through_nodes(nodes, arc, s)


def exposed(scenes: Sequence[Scene], spacing: float) -> Curve:
    """The midline sampled about every `spacing` [m], each sample at its own moment.

    The scenes are moments evenly spread over the exposure; the samples visit the time between
    the first and the last in a golden-ratio sequence, so that neighbours together blur.
    """
    length = float(scenes[0].arc[-1])
    count = max(int(np.ceil(length / spacing)), 8)
    s = np.asarray((np.arange(count) + 0.5) * (length / count), dtype=np.float64)
    shapes = [midline(scene.points, scene.arc, s) for scene in scenes]
    if len(shapes) == 1:
        points, derivatives = shapes[0]
    else:
        share = _shares(count, len(shapes))
        points = np.einsum("mk,kmj->mj", share, np.array([p for p, _ in shapes]))
        derivatives = np.einsum("mk,kmj->mj", share, np.array([d for _, d in shapes]))
    return Curve(
        s, points, np.asarray(derivatives / np.hypot(*derivatives.T)[:, None], dtype=np.float64)
    )


def _shares(count: int, moments: int) -> Array:
    """(count, moments) weights of the moments in each sample: hats about its own instant.

    The exposure reaches half a step beyond its first and last moment.
    """
    instant = ((np.arange(count) * GOLDEN) % 1.0) * moments - 0.5
    left = np.clip(np.floor(instant).astype(int), 0, moments - 2)
    share = np.zeros((count, moments))
    rows = np.arange(count)
    share[rows, left + 1] = instant - left
    share[rows, left] = 1 - share[rows, left + 1]
    return share
