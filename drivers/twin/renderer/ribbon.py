"""The strip as material: its near cut edge and the faces that run from there to the far edge."""

from dataclasses import dataclass

import numpy as np

from drivers.twin.renderer.curve import Curve
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.splat import Cloud
from drivers.types import Array

GRAIN = 0.00025  # m, grid of the weave
PITCH = 0.5  # px between points of material
LIGHT = np.array([-0.35, 0.94])  # where the light comes from, in the plane
AMBIENT = 0.62
CUT = 1.08  # brightness of the cut edge, seen from the front
BACK = 0.93  # brightness of the side that lies on the desk


@dataclass(frozen=True, slots=True)
class Weave:
    """Brightness of the material: `face` (i, j) by arc length and y, `cut` (i,) by arc length."""

    face: Array
    cut: Array

    def at(self, s: Array, y: Array) -> Array:
        """Brightness of the face at arc lengths and depths (n,) [m]."""
        rows, columns = self.face.shape
        i = (s * (1 / GRAIN)).astype(np.int64) % rows
        j = (y * (1 / GRAIN)).astype(np.int64) % columns
        return np.asarray(self.face[i, j])

    def cut_at(self, s: Array) -> Array:
        """Brightness of the cut edge at arc lengths (n,) [m]."""
        return np.asarray(self.cut[(s * (1 / GRAIN)).astype(np.int64) % len(self.cut)])


def weave(depth: float, rng: np.random.Generator) -> Weave:
    """A twill of single yarns with variation `depth`, a share of brightness; 1 on average."""
    rows, columns = 2800, 400
    i, j = np.arange(rows)[:, None], np.arange(columns)[None, :]
    twill = np.sin(2 * np.pi * (i / 8 + j / 10))
    warp = rng.normal(size=(1, columns // 2)).repeat(2, axis=1)
    weft = rng.normal(size=(rows // 2, 1)).repeat(2, axis=0)
    slubs = rng.normal(size=(rows // 8, columns // 8)).repeat(8, axis=0).repeat(8, axis=1)
    face = 1 + depth * (0.5 * twill + 0.5 * warp + 0.6 * weft + 0.7 * slubs)
    yarns = rng.normal(size=rows // 4).repeat(4) + rng.normal(size=rows // 20).repeat(20)
    return Weave(np.clip(face, 0.3, 1.7), np.clip(1 + depth * yarns, 0.3, 1.7))


def faces(curve: Curve, optics: Optics, look: StripLook, material: Weave) -> Cloud:
    """Points of the side that the camera sees, from the near edge to the far one."""
    near = optics.plane(curve.points)
    across = optics.plane(curve.points, look.width) - near
    along = optics.plane(curve.points + curve.steps) - near
    area = np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
    rows = np.ceil(area / np.hypot(*along.T) / PITCH).astype(np.int64)
    which = np.repeat(np.arange(len(rows)), rows)
    first = np.cumsum(rows) - rows
    depth = (np.arange(len(which)) - first[which] + 0.5) / rows[which]
    shade = _lit(curve, optics)[which] * material.at(curve.s[which], depth * look.width)
    u, v = (near[which, j] + depth * across[which, j] for j in range(2))
    return Cloud(u, v, (area / np.maximum(rows, 1))[which], shade)


def near_edge(curve: Curve, optics: Optics, look: StripLook, material: Weave) -> Cloud:
    """Points of the cut edge in the plane y = 0: half a thickness to either side of the midline."""
    half = curve.normals * (look.thickness / 2)
    upper, lower = optics.plane(curve.points + half), optics.plane(curve.points - half)
    across = lower - upper
    along = optics.plane(curve.points + curve.steps) - (upper + lower) / 2
    area = np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
    rows = max(int(np.ceil(np.hypot(*across.T).max() / PITCH)), 2)
    depth = (np.arange(rows) + 0.5) / rows
    u, v = ((upper[:, j, None] + depth * across[:, j, None]).ravel() for j in range(2))
    shade = CUT * material.cut_at(curve.s)
    return Cloud(u, v, np.repeat(area / rows, rows), np.repeat(shade, rows))


def _lit(curve: Curve, optics: Optics) -> Array:
    """(m,) brightness of the side that faces the camera, by Lambert's law."""
    normals = curve.normals
    outside = ((optics.centre[[0, 2]] - curve.points) * normals).sum(axis=-1)
    side = np.where(outside >= 0, 1.0, -1.0)
    diffuse = np.maximum((normals @ LIGHT) * side, 0.0)
    return np.asarray((AMBIENT + (1 - AMBIENT) * diffuse) * np.where(side > 0, 1.0, BACK))
