"""Midlines of thin bright objects: drawn ones, and photographs of real yarn."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from cell.setup.strips.photograph import extract_midline
from drivers.base.geometry import even_points
from tests.support.shared import PHOTOGRAPHS, YARN, needs


@needs(YARN)
@pytest.mark.parametrize("photo", PHOTOGRAPHS, ids=lambda p: p.stem[-4:])
def test_midline_of_real_yarn_runs_from_ledge_to_tip_inside_the_yarn(
    photo: Path,
) -> None:
    image = cv2.imread(str(photo))
    line = extract_midline(image)
    dense = even_points(line.points, 3000)
    u, v = np.clip(np.rint(dense).astype(int), 0, np.array(image.shape[1::-1]) - 1).T
    grey = cv2.GaussianBlur(image.max(axis=2), (0, 0), 3)
    bright = float(np.percentile(grey[v, u], 90))
    dark = float(np.median(grey[:, -10:]))
    assert (grey[v, u][:-30] > (dark + bright) / 2).all()
    # the tip itself is an edge
    assert (grey[v, u][-30:] > dark + 0.3 * (bright - dark)).all()

    across = np.percentile(np.hypot(*np.gradient(line.points, axis=0).T), [1, 99])
    assert across[1] / across[0] < 1.3  # equal steps: no point jumps to fluff and back

    assert line.points[0, 0] < 2
    assert line.points[0, 1] < 0.15 * image.shape[0]
    rows, columns = np.nonzero(cv2.erode(grey, np.ones((9, 9))) > (dark + bright) / 2)
    lowest = columns[rows == rows.max()]
    assert abs(line.points[-1, 1] - rows.max()) < line.width
    assert np.abs(line.points[-1, 0] - lowest).min() < line.width
