"""Figure of an exam: confusion matrix, reliability, and rates by strength of the effect."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tests.lab.exam.scoring.score import Outcome
from tests.lab.exam.scoring.statistics import Bin, Confusion, rate

INK, FAINT, WRONG, RIGHT_COLOUR = "#22272e", "#c9ced6", "#c2553b", "#2f6db3"
DARK = 0.6  # share of a row from which its cell is dark
EDGES = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, float("inf"))  # of the groups by excess gap


def figure(table: Confusion, bins: Sequence[Bin], found: Sequence[Outcome]) -> Figure:
    """Draw the figure of an exam: confusion matrix above, reliability and rates below."""
    height = 1.6 + 0.24 * len(table.rows)
    drawn = Figure(figsize=(max(9.0, 3.5 + 0.36 * len(table.columns)), height + 4.0),
                   layout="constrained")  # fmt: skip
    top, below = np.ravel(drawn.subfigures(2, 1, squeeze=False, height_ratios=[height, 3.2]))
    _matrix(top.subplots(), table)
    left, right = below.subplots(1, 2)
    _reliability(left, bins)
    _strength(right, found)
    for axis in (left, right):
        _remove_spines(axis)
    return drawn


def _remove_spines(axis: Axes) -> None:
    axis.tick_params(colors=INK, labelsize=8)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def _matrix(axis: Axes, table: Confusion) -> None:
    """Draw the counts of the confusion matrix, shaded by their share of the row."""
    counts = np.array([[table.count(r, c) for c in table.columns] for r in table.rows])
    share = counts / counts.sum(axis=1, keepdims=True)
    axis.imshow(share, cmap="Blues", vmin=0.0, vmax=1.3, aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        ink = "white" if share[i, j] > DARK else INK
        axis.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=7, color=ink)
    axis.set_yticks(range(len(table.rows)), table.rows, fontsize=8)
    axis.set_xticks(range(len(table.columns)), table.columns, fontsize=8, rotation=50, ha="right")
    axis.set_ylabel("hidden", fontsize=8)
    axis.set_xlabel("said", fontsize=8)


def _reliability(axis: Axes, bins: Sequence[Bin]) -> None:
    axis.plot([0, 1], [0, 1], color=FAINT, lw=1.0)
    for b in bins:
        axis.plot([b.confidence] * 2, b.right.interval, color=RIGHT_COLOUR, lw=1.2)
        axis.plot(b.confidence, b.right.value, "o", color=RIGHT_COLOUR, ms=4)
        at = (b.confidence, b.right.value)
        axis.annotate(str(b.right.count), at, (-5, -3), textcoords="offset points", ha="right",
                      fontsize=7, color=INK)  # fmt: skip
    axis.set(xlim=(0, 1.02), ylim=(0, 1.02))
    axis.set_xlabel("stated confidence", fontsize=8)
    axis.set_ylabel("right, by class", fontsize=8)


def _strength(axis: Axes, found: Sequence[Outcome]) -> None:
    """Draw right and wrong names of single effects over the gap left by the refitted base."""
    single = [o for o in found if o.kind == "single"]
    groups = [[o for o in single if low <= o.realised < high] for low, high in pairwise(EDGES)]
    right = [rate(o.right for o in group) for group in groups]
    wrong = [rate(o.result == "wrong_name" for o in group) for group in groups]
    for aside, colour, words, rates in (
        (-0.08, RIGHT_COLOUR, "right, by class", right),
        (0.08, WRONG, "wrong name", wrong),
    ):
        for i, each in enumerate(rates):
            if each.count:
                axis.plot([i + aside] * 2, each.interval, color=colour, lw=1.2)
                axis.plot(i + aside, each.value, "o", color=colour, ms=4)
        axis.plot([], [], "o", color=colour, ms=4, label=words)
    labels = [f"{low:g}-{high:g}" if np.isfinite(high) else f"> {low:g}"
              for low, high in pairwise(EDGES)]  # fmt: skip
    counts = [len(group) for group in groups]
    axis.set_xticks(range(len(groups)), [f"{w}\n{n}" for w, n in zip(labels, counts, strict=True)])
    axis.set(ylim=(-0.02, 1.02))
    axis.set_xlabel("excess gap left by the refitted base, and cases", fontsize=8)
    axis.set_ylabel("share of single effects", fontsize=8)
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8, frameon=False)
