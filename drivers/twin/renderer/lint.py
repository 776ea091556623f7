"""Lint or glare where the strip leaves the desk, which biases contact_x and no other feature.

Lint of the strip's colour in front of its near edge closes the wedge between strip and desk, so
that the strip seems to leave it later. Glare of the desk hides the foot of the edge, so that it
seems to leave it earlier. The upper outline stays unchanged.
"""

import numpy as np

from drivers.strip.model import CONTACT_HEIGHT
from drivers.strip.shape import desk_contact
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.ribbon import CUT
from drivers.twin.renderer.stage import fill
from drivers.twin.scene import Scene
from drivers.types import Array, Image

# m by which an abrupt end looks further along (lint) or back (glare) than one that lifts evenly.
ABRUPT_LINT, ABRUPT_GLARE = 0.0003, 0.0008
PILE = 0.0009  # m that it reaches over the lowest strip, more than lens and pixels blur


def draw_lint(
    image: Image, empty: Image, scene: Scene, optics: Optics, bias: float, look: tuple[Array, float]
) -> None:
    """Draw lint or glare that shifts the apparent contact of `scene` by `bias` [m] along x.

    `empty` (h, w, 3) shows the same region without a strip; `look` is the strip's colour (3,) BGR
    in its light, and its thickness [m].
    """
    colour, thickness = look
    if bias == 0 or not (scene.points[:, 1] > CONTACT_HEIGHT).any():
        return
    contact = desk_contact(scene.points, CONTACT_HEIGHT)
    low, high = -thickness / 2, CONTACT_HEIGHT - thickness / 2 + PILE
    if bias > 0:
        left, right = contact - PILE, contact + max(bias - ABRUPT_LINT, 0.0)
    else:
        left, right = contact + min(bias + ABRUPT_GLARE, 0.0), contact + PILE
    outline = optics.plane(np.array([(left, low), (right, low), (right, high), (left, high)]))
    if bias > 0:
        fill(image, outline, CUT * colour)
    else:
        _lay_bare(image, empty, outline)


def _lay_bare(image: Image, empty: Image, outline: Array) -> None:
    """Show `empty` (h, w, 3) inside the `outline` (m, 2) [px] on `image` (h, w, 3), in place."""
    cover = np.zeros_like(image)
    fill(cover, outline, np.full(3, 255.0))
    share = cover / 255.0
    image[:] = share * empty + (1.0 - share) * image + 0.5
