"""Figures over the paper's range: displacement and holding force of each policy."""

from typing import Any

import numpy as np

from cell.benchmark.figures.style import PAGE_WIDTH, colour, dot, policy_rows
from cell.benchmark.numbers import numeral
from cell.benchmark.results import RangeFolds, Results
from cell.report.drawing import INK, MUTED, as_svg, canvas
from cell.report.words import MINUS
from policies.domain import DAMPING_RATIO, STIFFNESS_RANGE

COLOUR_RANGE = 90.0  # mm, where the colours end
LINEAR = 8.0  # mm, up to about which the colour scale is linear
BAR_TICKS = (-80, -20, -5, 5, 20, 80)
FEWEST_COLUMNS = 3  # panels that the figure's height suits


def maps_figure(results: Results) -> str:
    """Figure (SVG) of d over stiffness and damping, a map a policy; empty without data."""
    found = [results.over_range(policy, "rod") for policy in results.asked.policies]
    measured = [folds for folds in found if folds is not None]
    if not measured:
        return ""
    with canvas(PAGE_WIDTH, 2.5) as figure:
        columns = max(len(measured), FEWEST_COLUMNS)
        panels = figure.subplots(1, columns, sharey=True, squeeze=False)[0]
        maps = [_draw_map(axes, folds) for axes, folds in zip(panels, measured, strict=False)]
        for axes in panels[len(measured) :]:
            axes.set_axis_off()
        panels[0].set_ylabel("damping over the least")
        bar = figure.colorbar(maps[-1], ax=list(panels), shrink=0.8, pad=0.01, aspect=22)
        bar.outline.set_visible(False)
        bar.minorticks_off()
        bar.set_ticks(BAR_TICKS, labels=[f"{tick:+d}".replace("-", MINUS) for tick in BAR_TICKS])
        bar.set_label("d  [mm]")
        return as_svg(figure)


def force_figure(results: Results) -> str:
    """Figure (SVG) of the force on the fixed edge, over the paper's range."""
    policies = results.asked.policies
    with canvas(PAGE_WIDTH, 0.34 * len(policies) + 0.7) as figure:
        axes = figure.add_subplot()
        for row, policy in enumerate(policies):
            folds = results.over_range(policy, "rod")
            if folds is None:
                continue
            low, high = np.quantile(folds.force, [0.05, 0.95])
            axes.plot([low, high], [row, row], color=colour(policy), lw=5, alpha=0.25)
            mean = float(np.mean(folds.force))
            axes.plot(mean, row, **dot(policy), gid=policy)
            axes.annotate(f"{mean:.2f} N", (high, row), (7, 0), textcoords="offset points",
                          va="center", fontsize=8.5, color=INK)  # fmt: skip
        policy_rows(axes, policies)
        axes.set_xlim(0, None)
        axes.margins(x=0.12)
        axes.set_xlabel("mean force from the take-over to the touch  [N]")
        return as_svg(figure)


def _draw_map(axes: Any, folds: RangeFolds) -> Any:
    """Draw d over stiffness and damping, with its mean and worst size; returns the colour mesh."""
    from matplotlib.colors import AsinhNorm

    norm = AsinhNorm(LINEAR, vmin=-COLOUR_RANGE, vmax=COLOUR_RANGE)
    k = _cell_borders(STIFFNESS_RANGE[0], STIFFNESS_RANGE[1], folds.side)  # stiffness
    b = _cell_borders(1.0, DAMPING_RATIO, folds.side)  # damping over the least
    colours = axes.pcolormesh(k, b, 1e3 * folds.d.T, cmap="RdBu_r", norm=norm, lw=0)
    axes.set(xscale="log", yscale="log", xlim=(k[0], k[-1]), ylim=(b[0], b[-1]))
    axes.set_xticks([0.02, 0.06, 0.2], ["0.02", "0.06", "0.2"])
    axes.set_yticks([1, 7, 50], ["1", "7", "50"])
    axes.minorticks_off()
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    size = np.abs(folds.d[np.isfinite(folds.d)])
    mean, worst = (size.mean(), size.max()) if size.size else (np.nan, np.nan)
    axes.set_title(folds.policy, fontsize=9.5, color=colour(folds.policy), loc="left", pad=25)
    caption = f"mean {numeral(float(mean))}\nworst {numeral(float(worst))}"
    axes.text(0, 1.03, caption, transform=axes.transAxes, fontsize=8.2, color=MUTED)
    axes.set_xlabel("stiffness  [N m/rad]", fontsize=8)
    return colours


def _cell_borders(low: float, high: float, side: int) -> Any:
    """Borders (side + 1,) of `side` logarithmic cells, centred from `low` to `high`."""
    step = (high / low) ** (1 / (side - 1))
    return low * step ** (np.arange(side + 1) - 0.5)
