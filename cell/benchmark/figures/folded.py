"""The folded strip at rest: its shape, and its height against the heavy elastica."""

import numpy as np

from cell.benchmark import paper
from cell.benchmark.figures.style import WIDTH, smooth, stiffness_colours
from cell.benchmark.results import Laid, Results
from cell.report.drawing import MUTED, as_svg, canvas

SHOWN = 130.0  # mm of the fold


def folded_figure(results: Results) -> str:
    """Shapes of folds, aligned at their ends, and their heights over bending length; SVG."""
    laid = [r for r in results.results if isinstance(r, Laid)]
    if not laid:
        return ""
    with canvas(WIDTH, 2.3) as figure:
        left, right = figure.subplots(1, 2, width_ratios=[1.7, 1])
        shades = stiffness_colours(len(laid))
        for fold, shade in zip(laid, shades, strict=True):
            shape = 1e3 * smooth(np.array(fold.shape))
            shape[:, 0] -= shape[:, 0].max()
            near = shape[:, 0] > -SHOWN
            left.plot(*shape[near].T, color=shade, lw=1.8)
            right.plot(1e3 * fold.bending_length, shape[:, 1].max(), "o", color=shade, ms=5)
            h = shape[:, 1].max()
            right.annotate(f"{h:.1f}", (1e3 * fold.bending_length, h), (6, -6),
                           textcoords="offset points", color=shade, fontsize=8)  # fmt: skip
        c = np.array([0.0, 1.08e3 * max(fold.bending_length for fold in laid)])
        right.plot(c, paper.FOLDED_HEIGHT * c, color=MUTED, lw=1)
        right.annotate("0.9066 c", (c[1], paper.FOLDED_HEIGHT * c[1]), (-8, -2),
                       textcoords="offset points", ha="right", color=MUTED, fontsize=8)  # fmt: skip
        left.set(xlabel="x from the fold's end  [mm]", ylabel="z  [mm]", aspect="equal")
        left.set_ylim(-1.5, None)
        right.set(xlabel="bending length c  [mm]", ylabel="height h  [mm]")
        return as_svg(figure)
