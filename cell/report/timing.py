"""Figures of the images' age and the loop's computing time."""

from typing import Any

import numpy as np

from cell.record.header import ArmTiming
from cell.record.run import Run
from cell.report.drawing import BLUE, GREEN, INK, MUTED, PURPLE, as_svg, canvas
from drivers.types import Array

READING = frozenset({"LIFT", "FOLD", "TOUCHED"})  # states in which images are read
BINS = 40
OUTER_QUANTILES = (0.005, 0.995)  # between which values decide on the bins; others are clipped
LOG_SCALE_RATIO = 30.0  # largest over smallest, from where on a scale is logarithmic


def image_ages(run: Run) -> Array:
    """Age (n,) [s] of the newest image at each control cycle that reads images."""
    ticks = run.ticks
    reading = np.array([state in READING for state in ticks.state], dtype=bool)
    used = reading if reading.any() else np.ones(ticks.t.size, dtype=bool)
    return np.asarray(ticks.image_age[used & np.isfinite(ticks.image_age)])


def timing_figure(run: Run) -> str:
    """Histograms (SVG) of image age, row interval, computing time, and a real arm's intervals."""
    arm = run.header.arm_timing
    with canvas(8.4, 2.5, layout=None) as figure:  # a layout that is solved takes half the time
        frame = {"left": 0.01, "right": 0.985, "top": 0.9, "bottom": 0.185, "wspace": 0.06}
        panels = figure.subplots(1, 3 if arm is None else 4, gridspec_kw=frame)
        age, interval, cost, *rest = panels
        if arm is not None:
            _draw_intervals(rest[0], arm)
        _draw_histogram(age, image_ages(run), "age of the newest image  [ms]", BLUE)
        _draw_histogram(interval, np.diff(run.ticks.t), "from row to row  [ms]", GREEN)
        _draw_histogram(cost, run.costs(), "computing in one turn  [ms]", PURPLE)
        return as_svg(figure)


def _draw_intervals(axes: Any, timing: ArmTiming) -> None:
    """Draw shares of the arm's states by the interval before each, on a logarithmic scale."""
    edges = [timing.edges_ms[0] / 2, *timing.edges_ms, 2 * timing.edges_ms[-1]]
    axes.stairs(timing.counts, edges, color=MUTED, fill=True, alpha=0.75)
    axes.set_xscale("log")
    axes.set_yscale("symlog")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("from state to state of the arm  [ms]")
    on_time = "" if timing.answered is None else f", {100 * timing.answered:.1f} % answered"
    title = f"longest {timing.longest_ms:.3g}{on_time}"
    axes.set_title(title, fontsize=8.5, color=MUTED, loc="left", pad=4)


def _draw_histogram(axes: Any, times: Array, label: str, colour: str) -> None:
    """Draw the distribution of `times` (n,) [s] in ms; values that are no numbers are left out."""
    with np.errstate(all="ignore"):
        values = 1e3 * times
    values = values[np.isfinite(values)]
    axes.set_xlabel(label)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    if values.size == 0:
        axes.set_xticks([])
        axes.text(0.5, 0.5, "not recorded", ha="center", color=MUTED, transform=axes.transAxes)
        return
    middle = float(np.median(values))
    edges, wide = _bin_edges(values)
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    axes.stairs(counts, edges, color=colour, fill=True, alpha=0.75, lw=0)
    axes.set_ylim(0, None)
    if wide:
        axes.set_xscale("log")
        axes.minorticks_off()
        axes.xaxis.set_major_formatter("{x:g}")
    else:
        axes.ticklabel_format(useOffset=False)
    axes.axvline(middle, color=INK, lw=0.9)
    text = f"median {_three_digits(middle)}, most {_three_digits(float(values.max()))}"
    axes.set_title(text, fontsize=8.5, color=MUTED, loc="left", pad=4)


def _three_digits(value: float) -> str:
    """Text of `value` with three digits, without powers of ten."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _bin_edges(values: Array) -> tuple[Array, bool]:
    """Edges (BINS + 1,) of bins for `values` (n,), and whether these are logarithmic."""
    low, high = (float(np.quantile(values, q)) for q in OUTER_QUANTILES)
    if low > 0 and high > LOG_SCALE_RATIO * low:
        return np.geomspace(0.8 * low, 1.2 * high, BINS + 1), True
    margin = max(0.05 * abs(float(np.median(values))), 0.1 * (high - low), 1e-4)
    return np.linspace(low - margin, high + margin, BINS + 1), False
