"""The outer side of silhouettes with breaks where the strip is seen edge-on."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from cell.perception.kernels import LEVEL_SPAN, ZERO_LEVEL
from cell.perception.region import Sizes
from cell.perception.silhouette import Grip, Side, outer_side, silhouette
from drivers.types import Image

HEIGHT, WIDTH = 320, 700
FOLD = np.array(
    [(20, 300), (520, 300), (570, 270), (560, 220), (510, 210), (440, 260), (380, 290), (320, 280),
     (290, 200), (280, 30)],
    dtype=np.float64,
)  # fmt: skip
EDGE_ON = 4  # piece of the fold
GRIP = Grip(FOLD[-1], np.array([0.0, -1.0]), 6.0, 30.0)
SIZES = Sizes(scale=5.9e-4, light=5, hanging=9, bridge=45.0, aside=30.0, deep=24.0)
CONTACT = np.array([500.0, 303.0])


def band() -> Image:
    """A fold whose upper layer rests on the lower one, and is edge-on left of its loop."""
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    for k, (here, there) in enumerate(pairwise(FOLD.astype(int).tolist())):
        cv2.line(mask, here, there, 255, 2 if k == EDGE_ON else 9)
    return mask


def broken(at: tuple[int, int], size: int) -> Image:
    mask = band()
    cv2.circle(mask, at, size, 0, -1)
    return mask


def side_of(mask: Image) -> Side:
    side = outer_side(mask, CONTACT, GRIP, 3, SIZES)
    assert side is not None
    return side


@pytest.mark.parametrize("size", [8, 14])
def test_break_beside_touching_layers_leads_no_outline_into_the_fold(size: int) -> None:
    whole, mended = side_of(band()), side_of(broken((478, 233), size))
    assert mended.missing == 0.0
    assert len(mended.points) == pytest.approx(len(whole.points), rel=0.05)
    apart = np.hypot(*(mended.points[:, None] - whole.points[None]).transpose(2, 0, 1)).min(axis=1)
    assert apart.max() < 10.0


def test_ends_that_do_not_point_at_each_other_are_no_break() -> None:
    mask = band()
    cv2.line(mask, (150, 296), (150, 280), 255, 5)
    cv2.line(mask, (170, 296), (170, 280), 255, 5)
    assert len(side_of(mask).points) == len(side_of(band()).points)


@pytest.mark.parametrize("angle", [0.0, 30.0, -50.0])
def test_edge_on_strip_that_hangs_askew_is_found_in_noise(angle: float) -> None:
    rng = np.random.default_rng(1)
    levels = rng.normal(ZERO_LEVEL, 0.05 * LEVEL_SPAN, (HEIGHT, WIDTH))
    way = np.array([np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    line = np.zeros((HEIGHT, WIDTH))
    ends = [np.rint(np.array([350, 160]) + s * 120 * way).astype(int) for s in (-1, 1)]
    cv2.line(line, ends[0].tolist(), ends[1].tolist(), 1.0, 2)
    soft = np.clip(levels + 0.18 * LEVEL_SPAN * line, 0, 255).astype(np.uint8)
    everywhere = np.full((HEIGHT, WIDTH), 255, dtype=np.uint8)

    mask = silhouette(soft, 0.12, everywhere, everywhere, SIZES.hanging)
    assert (mask[line > 0] > 0).mean() > 0.8
    assert (mask > 0).mean() < 0.02
