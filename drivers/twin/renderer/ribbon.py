"""Midline of the strip during an exposure, and material points of its surface in the
image.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.base.geometry import interpolate_columns, left_normals, lengths, unit
from drivers.base.types import Array
from drivers.twin.renderer.kernels import MaterialRows, sample_surface
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.world import WorldState

GRAIN = 0.0005  # m, grid of the weave
WEAVE_ROWS, WEAVE_COLUMNS = 2048, 128  # cells of the grid after which the weave repeats
PITCH = 0.5  # px between points of material along the strip
DEPTH_PITCH = 0.65  # px between points of material across its faces
# m of half a thickness by which the corners of a cut edge are rounded off
EDGE_RADIUS = 0.001
LENS_PROBE = 0.001  # m, over which the lens counts as linear
LIGHT_DIRECTION = np.array([-0.35, 0.94])  # where the light comes from, in the plane
AMBIENT = 0.62
CUT = 1.08  # brightness of the cut edge from the front
BACK_BRIGHTNESS = 0.93  # brightness of the side that lies on the desk


@dataclass(frozen=True, slots=True)
class ExposedMidline:
    """Midline of a strip at arc lengths `s` (m,) [m]: `points` (m, 2) [m], unit
    `tangents` (m, 2).

    `motion` (m, 2) [m] is how far the points move during the exposure, empty for a
    strip at rest.
    """

    s: Array
    points: Array
    tangents: Array
    motion: Array

    @property
    def steps(self) -> Array:
        """Vectors (m, 2) [m] along the curve, as long as the spacing of the samples."""
        steps: Array = self.tangents * (self.s[1] - self.s[0])
        return steps

    @property
    def normals(self) -> Array:
        """Unit normals (m, 2) of the curve, to the left: up for a strip lying along
        +x.
        """
        return left_normals(self.tangents)


def expose(scenes: Sequence[WorldState], spacing: float) -> ExposedMidline:
    """Midline of the strip in `scenes`, sampled about every `spacing` [m], during an
    exposure.

    The scenes are at the middles of equal parts of the exposure; the middle one gives
    the shape, the first and the last the motion, which is assumed uniform.
    """
    first = scenes[0]
    middle = scenes[len(scenes) // 2]
    last = scenes[-1]
    length = middle.arc[-1]
    count = max(int(np.ceil(length / spacing)), 8)
    s = np.linspace(0.5, count - 0.5, count) * (length / count)

    nodes = smooth(middle.points, middle.arc)
    slopes = np.gradient(nodes, middle.arc, axis=0, edge_order=2)
    points, derivatives = _hermite(nodes, slopes, middle.arc, s)

    motion = np.empty((0, 2))
    if first.points is not last.points:
        shift = (last.points - first.points) * (len(scenes) / (len(scenes) - 1))
        motion = interpolate_columns(s, middle.arc, shift)
    return ExposedMidline(s=s, points=points, tangents=unit(derivatives), motion=motion)


def _hermite(nodes: Array, slopes: Array, arc: Array, s: Array) -> tuple[Array, Array]:
    """Points (m, 2) [m] and derivatives (m, 2) of a cubic Hermite curve at arc lengths
    `s` (m,).

    It passes through `nodes` (n, 2) with `slopes` (n, 2) at arc lengths `arc` (n,): at
    t, from 0 to 1 on a piece of length h, by p = p0 + h t (a + t (b + t c)).
    """
    i = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(arc) - 2)
    h = np.diff(arc)[i, None]
    t = (s - arc[i])[:, None] / h
    chord = np.diff(nodes, axis=0)[i] / h
    a = slopes[i]
    end = slopes[i + 1]
    b = 3 * chord - 2 * a - end
    c = a + end - 2 * chord
    return nodes[i] + h * t * (a + t * (b + t * c)), a + t * (2 * b + 3 * t * c)


def smooth(points: Array, arc: Array) -> Array:
    """Nodes (n, 2) [m] of the smooth curve nearest to straight links between `points`
    (n, 2) [m], which lie at arc lengths `arc` (n,) [m].

    A curve through the ends of straight links lies outside them by kappa h^2 / 12 on
    average. Moving the nodes in by as much, a twelfth of their second difference where
    the links are equal, removes that bias, so that contact and profile measured along
    the links are those of the picture.
    """
    spans = np.diff(arc)
    bend = np.diff(np.diff(points, axis=0) / spans[:, None], axis=0)
    nodes = points.copy()
    before = spans[:-1]
    after = spans[1:]
    nodes[1:-1] += bend * (before * after / (6 * (before + after)))[:, None]
    return nodes


@dataclass(frozen=True, slots=True)
class Weave:
    """Brightness of a fabric as tables: that of its `face` by arc length and depth,
    that of its edge, `cut`, by arc length.
    """

    face: Array
    cut: Array


def random_weave(depth: float, rng: np.random.Generator) -> Weave:
    """Draw the brightness of a random twill, whose yarns vary about 1 by the fraction
    `depth`.
    """
    i = np.arange(WEAVE_ROWS)[:, None]
    j = np.arange(WEAVE_COLUMNS)[None, :]
    twill = np.sin(2 * np.pi * (i / 4 + j / 5))
    warp = rng.normal(size=(1, WEAVE_COLUMNS))
    weft = rng.normal(size=(WEAVE_ROWS, 1))
    slubs = rng.normal(size=(WEAVE_ROWS // 4, WEAVE_COLUMNS // 4))
    slubs = slubs.repeat(4, axis=0).repeat(4, axis=1)
    face = 1 + depth * (0.5 * twill + 0.5 * warp + 0.6 * weft + 0.7 * slubs)

    thin = rng.normal(size=WEAVE_ROWS // 2).repeat(2)
    thick = rng.normal(size=WEAVE_ROWS // 8).repeat(8)
    cut = 1 + depth * (thin + thick)[:, None]
    return Weave(face=np.clip(face, 0.3, 1.7), cut=np.clip(cut, 0.3, 1.7))


@dataclass(frozen=True, slots=True)
class MidlineImage:
    """Midline of a strip in an image: points `near` (m, 2) [px], and vectors (m, 2)
    [px] at them.

    `along` (m, 2) [px] is the curve from a point to the next, `half` (m, 2) half of the
    strip's thickness along the normal, `motion` (m, 2) the path during the exposure,
    empty at rest.
    """

    near: Array
    along: Array
    half: Array
    motion: Array


def project(curve: ExposedMidline, optics: Optics, look: StripLook) -> MidlineImage:
    """Image of a strip's midline `curve`, with the lens linearised about each point."""
    near = optics.plane(curve.points)
    along_x, along_z = LENS_PROBE * np.eye(2)
    by_x = (optics.plane(curve.points + along_x) - near) / LENS_PROBE  # px/m
    by_z = (optics.plane(curve.points + along_z) - near) / LENS_PROBE

    def in_pixels(vectors: Array) -> Array:
        pixels: Array = by_x * vectors[:, :1] + by_z * vectors[:, 1:]
        return pixels

    half = in_pixels(curve.normals * (look.thickness / 2))
    motion = in_pixels(curve.motion) if len(curve.motion) else curve.motion
    return MidlineImage(
        near=near, along=in_pixels(curve.steps), half=half, motion=motion
    )


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points (6, n) of a strip's surface in an image: u and v [px], area [px^2],
    brightness, arc length and depth [m].

    `tint` (n, 3) BGR are the points' colours; empty where all have the strip's.
    """

    points: Array
    tint: Array


def sample_face(
    curve: ExposedMidline,
    picture: MidlineImage,
    optics: Optics,
    look: StripLook,
    material: Weave,
) -> Cloud:
    """Material points of the strip's visible side in the image, from the near to the
    far edge.
    """
    across = optics.plane(curve.points, look.width) - picture.near
    area = _area(picture.along, across)
    rows = np.ceil(area / lengths(picture.along) / DEPTH_PITCH).astype(np.int64)
    # the visible side starts half a thickness off the midline, but for EDGE_RADIUS
    share = max(1 - 2 * EDGE_RADIUS / look.thickness, 0.0)
    surface = MaterialRows(
        start=picture.near + share * _facing(curve, optics)[:, None] * picture.half,
        across=across,
        motion=picture.motion,
        counts=rows,
        area=area * (1 / np.maximum(rows, 1)),
        shade=_lit(curve, optics),
        s=curve.s,
    )
    return _cloud(sample_surface(surface, material.face, (1 / GRAIN, look.width)), look)


def sample_edge(
    curve: ExposedMidline, picture: MidlineImage, look: StripLook, material: Weave
) -> Cloud:
    """Material points of the strip's near edge, half a thickness to either side of the
    midline.
    """
    half = picture.half
    thickness = 2 * lengths(half).max()
    rows = np.full(len(curve.s), max(int(np.ceil(thickness / PITCH)), 2))
    surface = MaterialRows(
        start=picture.near,
        across=half,
        motion=picture.motion,
        counts=rows,
        area=_area(picture.along, 2 * half) / rows,
        shade=np.full(len(curve.s), CUT),
        s=curve.s,
    )
    return _cloud(sample_surface(surface, material.cut, (1 / GRAIN, 0.0)), look)


def _cloud(points: Array, look: StripLook) -> Cloud:
    tint = look.tint(points[4], points[5])
    return Cloud(points, np.empty((0, 0)) if tint is None else tint)


def _area(along: Array, across: Array) -> Array:
    """Areas (m,) [px^2] of the parallelograms between `along` and `across` (m, 2)
    [px].
    """
    return np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])


def _facing(curve: ExposedMidline, optics: Optics) -> Array:
    """Sign at each point of `curve`: 1 where the camera sees the side to which the
    normal points, else -1.
    """
    outside = ((optics.centre[[0, 2]] - curve.points) * curve.normals).sum(axis=-1)
    return np.where(outside >= 0, 1.0, -1.0)


def _lit(curve: ExposedMidline, optics: Optics) -> Array:
    """Brightness of the strip's side that faces the camera at each point of `curve`, by
    Lambert's law.
    """
    side = _facing(curve, optics)
    diffuse = np.maximum((curve.normals @ LIGHT_DIRECTION) * side, 0.0)
    brightness: Array = AMBIENT + (1 - AMBIENT) * diffuse
    return brightness * np.where(side > 0, 1.0, BACK_BRIGHTNESS)
