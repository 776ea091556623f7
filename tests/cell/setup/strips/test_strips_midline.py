"""Midlines of thin bright objects: drawn ones, and photographs of real yarn."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from cell.setup.strips.photograph import extract_midline
from drivers.base.errors import ConfigurationError

YARN = Path(__file__).parents[5] / "shared" / "data" / "yarn"
PHOTOGRAPHS = sorted(YARN.glob("*.jpg"))


@pytest.mark.parametrize("level", [0, 20])
def test_picture_without_object_is_refused(level: int) -> None:
    with pytest.raises(ConfigurationError, match="no bright object"):
        extract_midline(np.full((300, 200, 3), level, np.uint8))


@pytest.mark.skipif(
    not PHOTOGRAPHS, reason="the photographs of yarn are not beside the checkout"
)
@pytest.mark.parametrize("photo", PHOTOGRAPHS, ids=lambda p: p.stem[-4:])
def test_midline_of_real_yarn_runs_from_ledge_to_tip_inside_the_yarn(
    photo: Path,
) -> None:
    image = cv2.imread(str(photo))
    line = extract_midline(image)
    dense = np.stack(
        [
            np.interp(np.linspace(0, 199, 3000), np.arange(200), c)
            for c in line.points.T
        ],
        axis=1,
    )
    u, v = np.clip(np.rint(dense).astype(int), 0, np.array(image.shape[1::-1]) - 1).T
    grey = cv2.GaussianBlur(image.max(axis=2), (0, 0), 3)
    bright = float(np.percentile(grey[v, u], 90))
    dark = float(np.median(grey[:, -10:]))
    assert (grey[v, u][:-30] > (dark + bright) / 2).all()
    # the tip itself is an edge
    assert (grey[v, u][-30:] > dark + 0.3 * (bright - dark)).all()

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
