"""Matplotlib figures as SVG that inherits colours and fonts from the page."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

from cell.report.readings import POINTS_PER_INCH, name_artists, readings

INK, MUTED, RULE, PAPER = "#1b1f24", "#6b7280", "#e3e5e8", "#fffffe"
BLUE, ORANGE, GREEN, PURPLE = "#2f6db5", "#cf6a1f", "#3a8a5c", "#8a5fb0"
METADATA = ("Creator", "Date", "Format", "Type")
VARIABLES = {
    INK: "--ink", MUTED: "--muted", RULE: "--rule", PAPER: "--paper",
    BLUE: "--blue", ORANGE: "--orange", GREEN: "--green", PURPLE: "--purple",
}  # fmt: skip
"""Colours that a page has for the light and for the dark."""
STYLE: dict[str, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cell",
    "path.simplify_threshold": 0.02,  # values are read off the paths
    "text.parse_math": False,  # names may hold any character
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": MUTED,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}


@contextmanager
def canvas(
    width: float, height: float, layout: Literal["constrained"] | None = "constrained"
) -> Iterator[Any]:
    """An empty figure of `width` x `height` [inch] in the style of the report."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        yield Figure(figsize=(width, height), layout=layout)


def as_svg(figure: Any) -> str:
    """Render `figure` as an SVG element; the same figure gives the same text."""
    from matplotlib import rc_context

    text = io.StringIO()
    name_artists(figure)
    with rc_context(STYLE):
        figure.savefig(text, format="svg", metadata=dict.fromkeys(METADATA))
    width = f'style="--width:{POINTS_PER_INCH * figure.get_size_inches()[0]:.0f}pt"'
    return page_svg(text.getvalue()).replace("<svg", f"<svg {readings(figure)} {width}", 1)


def page_svg(text: str) -> str:
    """Convert an SVG document to an element of a page that inherits width, fonts and colours."""
    svg = text[text.index("<svg") :].strip()
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r" ?font-family: [^;\"]*;?", "", svg)
    for colour, variable in VARIABLES.items():
        svg = svg.replace(colour, f"var({variable})")
    return svg
