"""Colours, markers and common elements of all figures."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from cell.report.drawing import INK, MUTED, RULE
from drivers.geometry import arc_lengths
from drivers.types import Array
from policies.registry import look_of

PAGE_WIDTH = 8.4  # inch, of a page
NOTE = 8.0  # points
BAND = "#7fa98f"
STIFFNESS_COLOURS = ["#2f6db5", "#3f8f9c", "#3a8a5c"]  # from the softest strip to the stiffest
DASHES = (0, (4, 3))
CURVE_SAMPLES = 600  # points of a smooth curve
DISPLACEMENT = "d = l₁ − l₂  [mm]"


def colour(policy: str) -> str:
    """The colour of `policy`."""
    return look_of(policy).colour


def dot(policy: str) -> dict[str, Any]:
    """Arguments of matplotlib's `plot` for the marker of `policy`."""
    look = look_of(policy)
    return {
        "marker": look.marker,
        "ms": look.size,
        "mfc": look.colour,
        "mec": look.colour,
        "ls": "",
    }


def policy_rows(axes: Any, policies: Sequence[str], foot: float = 0.0) -> None:
    """Set up a row for each policy, the first on top, in its colour; `foot` free rows below."""
    axes.set_yticks(range(len(policies)), policies)
    axes.set_ylim(len(policies) - 0.5 + foot, -0.5)
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    for label, policy in zip(axes.get_yticklabels(), policies, strict=True):
        label.set(color=colour(policy), fontsize=9, fontweight="bold")


def zero(axes: Any) -> None:
    """Draw the line of d = 0, where the layers are aligned."""
    axes.axvline(0.0, color=INK, lw=0.8, zorder=1)


def desk(axes: Any) -> None:
    """Draw desk and fixed edge in a side view in millimetres."""
    axes.axhline(0.0, color=MUTED, lw=0.8, zorder=1)
    axes.plot(0, 0, "s", color=INK, ms=4, clip_on=False, zorder=5)
    axes.set_aspect("equal")
    axes.grid(color=RULE, lw=0.5)
    axes.spines["bottom"].set_visible(False)


def smooth(shape: Array) -> Array:
    """Dense curve (m, 2) through the nodes `shape` (n, 2) of a strip, for drawing."""
    s = arc_lengths(shape)
    return np.asarray(CubicSpline(s, shape)(np.linspace(0.0, s[-1], CURVE_SAMPLES)))


def stiffness_colours(count: int) -> list[Any]:
    """Colours from blue for the lowest stiffness to green for the highest, as in the paper."""
    from matplotlib.colors import LinearSegmentedColormap

    scale = LinearSegmentedColormap.from_list("stiffness", STIFFNESS_COLOURS)
    return [scale(i / max(count - 1, 1)) for i in range(count)]
