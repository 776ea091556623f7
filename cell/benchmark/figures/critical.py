"""Figure of critical points: gripper x at the first touch, over the folded height."""

from typing import Any

import numpy as np

from cell.benchmark import paper
from cell.benchmark.figures.style import PAGE_WIDTH
from cell.benchmark.results import CriticalPoints, Results
from cell.report.drawing import MUTED, as_svg, canvas
from drivers.types import Array

HEIGHT_COLOURS = ["#3f8fc4", "#6a4fb3", "#b0428f", "#cf6a1f"]


def critical_figure(results: Results) -> str:
    """Figure (SVG) of critical points, a panel a speed; areas span dampings, colours heights."""
    found = [r for r in results.results if isinstance(r, CriticalPoints)]
    if not found:
        return ""
    with canvas(PAGE_WIDTH, 3.6) as figure:
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for axes, points in zip(panels, found, strict=True):
            _draw_panel(axes, points)
        panels[0].set_ylabel("gripper x at the first touch  [mm]")
        return as_svg(figure)


def table(points: CriticalPoints) -> Array:
    """Gripper x (heights, stiffnesses, dampings) [m] at the first touch, NaN without one."""
    return np.array(points.x, dtype=np.float64)


def _draw_panel(axes: Any, points: CriticalPoints) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    scale = LinearSegmentedColormap.from_list("height", HEIGHT_COLOURS)
    h = 1e3 * paper.FOLDED_HEIGHT * np.array(points.bending_lengths)
    x = 1e3 * table(points)
    for i, height in enumerate(points.heights):
        shade = scale(i / max(len(points.heights) - 1, 1))
        here = np.ma.masked_invalid(x[i])
        axes.fill_between(
            h, here.min(axis=1), here.max(axis=1), color=shade, alpha=0.22, lw=0,
            gid=f"all of z = {1e3 * height:.0f} mm",
        )  # fmt: skip
        axes.plot(h, x[i, :, 0], color=shade, lw=1.3, gid=f"gripper x, z = {1e3 * height:.0f} mm")
        axes.annotate(
            f"z = {1e3 * height:.0f}", (h[-1], x[i, -1, 0]), (4, 0), textcoords="offset points",
            va="center", fontsize=8, color=MUTED, annotation_clip=False,
        )  # fmt: skip
    axes.set_xlabel("height h of the folded strip  [mm]")
    axes.set_title(f"moving at {1e3 * points.speed:.0f} mm/s", fontsize=9, color=MUTED, loc="left")
    axes.set_xlim(h[0], h[-1] + 3.2)
    axes.set_xticks([15, 20, 25, 30])
