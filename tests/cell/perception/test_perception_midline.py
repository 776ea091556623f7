"""Midlines of thin bright objects: drawn ones, and photographs of real yarn."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from cell.perception.midline import extract_midline
from drivers.errors import ConfigurationError
from drivers.types import Array, Image

YARN = Path(__file__).parents[4] / "shared" / "data" / "yarn"
PHOTOGRAPHS = sorted(YARN.glob("*.jpg"))


def _hook() -> tuple[Image, Array]:
    """A quarter circle from the left border and a straight fall, 24 px wide, with fluff."""
    angle = np.linspace(np.pi / 2, 0, 60)
    curve = np.vstack(
        [
            np.stack([-0.5 + 120 * np.cos(angle), 180 - 120 * np.sin(angle)], axis=1),
            np.stack([np.full(40, 119.5), np.linspace(185, 600, 40)], axis=1),
        ]
    )
    big = np.full((2800, 1200, 3), 25, np.uint8)
    path = np.rint((curve + 0.5) * 4 - 0.5).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(big, [path], False, (210, 220, 230), 96)
    cv2.line(big, (480, 1200), (900, 1000), (180, 180, 180), 8)
    cv2.circle(big, (1000, 300), 20, (240, 240, 240), -1)
    return cv2.resize(big, (300, 700), interpolation=cv2.INTER_AREA), curve


def _distance(points: Array, curve: Array) -> Array:
    dense = np.stack([np.interp(np.linspace(0, 99, 4000), np.arange(100), c) for c in curve.T], 1)
    return np.hypot(*(points[:, None] - dense[None]).transpose(2, 0, 1)).min(axis=1)


def test_midline_of_a_drawn_hook_is_its_curve() -> None:
    image, curve = _hook()
    line = extract_midline(image)
    assert _distance(line.points, curve)[:-10].max() < 1.5
    assert abs(line.width - 24) < 3
    assert np.hypot(*(line.points[0] - curve[0])) < 3
    assert line.points[-1, 1] == pytest.approx(612, abs=4)


@pytest.mark.parametrize("level", [0, 20])
def test_picture_without_object_is_refused(level: int) -> None:
    with pytest.raises(ConfigurationError, match="no bright object"):
        extract_midline(np.full((300, 200, 3), level, np.uint8))


def test_object_that_does_not_enter_at_the_left_is_refused() -> None:
    image = np.zeros((300, 200, 3), np.uint8)
    cv2.line(image, (80, 40), (120, 250), (255, 255, 255), 12)
    with pytest.raises(ConfigurationError, match="enters at the left border"):
        extract_midline(image)


@pytest.mark.skipif(not PHOTOGRAPHS, reason="the photographs of yarn are not beside the checkout")
@pytest.mark.parametrize("photo", PHOTOGRAPHS, ids=lambda p: p.stem[-4:])
def test_midline_of_real_yarn_runs_from_ledge_to_tip_inside_the_yarn(photo: Path) -> None:
    image = cv2.imread(str(photo))
    line = extract_midline(image)
    dense = np.stack(
        [np.interp(np.linspace(0, 199, 3000), np.arange(200), c) for c in line.points.T], axis=1
    )
    u, v = np.clip(np.rint(dense).astype(int), 0, np.array(image.shape[1::-1]) - 1).T
    grey = cv2.GaussianBlur(image.max(axis=2), (0, 0), 3)
    bright = float(np.percentile(grey[v, u], 90))
    dark = float(np.median(grey[:, -10:]))
    assert (grey[v, u][:-30] > (dark + bright) / 2).all()
    assert (grey[v, u][-30:] > dark + 0.3 * (bright - dark)).all()  # the tip itself is an edge

    across = np.percentile(np.hypot(*np.gradient(line.points, axis=0).T), [1, 99])
    assert across[1] / across[0] < 1.3  # equal steps: no point jumps to fluff and back

    body = cv2.morphologyEx(
        (grey > (dark + bright) / 2).astype(np.uint8),
        cv2.MORPH_OPEN,
        np.ones((int(line.width * 0.5),) * 2, np.uint8),
    )
    rows, columns = np.nonzero(body)
    assert line.points[0, 0] < 2
    assert line.points[0, 1] < 0.15 * image.shape[0]
    lowest = rows.max()
    assert abs(line.points[-1, 1] - lowest) < line.width
    assert columns[rows == lowest].min() - line.width < line.points[-1, 0]
    assert line.points[-1, 0] < columns[rows == lowest].max() + line.width
