"""Matplotlib figures as SVG with the page's colours and fonts, and data for the page's
script.

The figure stays the one drawing: Matplotlib's SVG, useful without a script, with text
as text and colours by CSS. D3 (281 kB, inlined once) takes it over in the browser
(`chart.js`), which reads values off the paths, so that no second copy of the data
travels.
"""

import io
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from html import escape
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cell.report.words import MINUS
from drivers.base.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, MUTED, RULE, PAPER = "#1b1f24", "#6b7280", "#e3e5e8", "#fffffe"
BLUE, ORANGE, GREEN, PURPLE, RED = "#2f6db5", "#cf6a1f", "#3a8a5c", "#8a5fb0", "#c2352b"
METADATA = ("Creator", "Date", "Format", "Type")
VARIABLES = {
    INK: "--ink",
    MUTED: "--muted",
    RULE: "--rule",
    PAPER: "--paper",
    BLUE: "--blue",
    ORANGE: "--orange",
    GREEN: "--green",
    PURPLE: "--purple",
    RED: "--bad",
}
"""CSS variables of colours, which a page sets for light and for dark."""
STYLE = Path(__file__).with_name("figures.mplstyle")
POINTS_PER_INCH = 72
NOTEBOOK_DPI = 110
Facts = dict[str, Any]


@contextmanager
def canvas(
    width: float, height: float, layout: Literal["constrained"] | None = "constrained"
) -> Iterator[Any]:
    """Matplotlib figure of `width` x `height` [inch] in the report's style, within the
    block.
    """
    from matplotlib import rc_context, rc_params_from_file

    with rc_context(rc_params_from_file(STYLE, use_default_template=False)):
        yield _page_figure()(figsize=(width, height), layout=layout)


@cache
def _page_figure() -> type["Figure"]:
    """Class of figures that a notebook shows, without a window's backend."""
    from matplotlib.figure import Figure

    class PageFigure(Figure):
        def _repr_png_(self) -> bytes:
            return as_png(self, NOTEBOOK_DPI)

    return PageFigure


def as_svg(figure: Any) -> str:
    """Render a Matplotlib `figure` as an SVG element; the same figure gives the same
    text.
    """
    from matplotlib import rc_context, rc_params_from_file

    text = io.StringIO()
    _name_artists(figure)
    with rc_context(rc_params_from_file(STYLE, use_default_template=False)):
        figure.savefig(text, format="svg", metadata=dict.fromkeys(METADATA))
    width = f'style="--width:{POINTS_PER_INCH * figure.get_size_inches()[0]:.0f}pt"'
    return _page_svg(text.getvalue()).replace(
        "<svg", f"<svg {readings(figure)} {width}", 1
    )


def as_png(figure: Any, dpi: int) -> bytes:
    """Render a Matplotlib `figure` as a PNG file on white."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=dpi, facecolor="white")
    return content.getvalue()


def _page_svg(text: str) -> str:
    """Convert an SVG document to an element that inherits width, fonts and colours of
    its page.
    """
    svg = text[text.index("<svg") :].strip()
    for side in ("width", "height"):
        svg = re.sub(rf'(<svg[^>]*?) {side}="[^"]*"', r"\1", svg, count=1)
    # a style's fonts, to its `;` or last quote
    svg = re.sub(r" ?font-family: [^;\"]*;?", "", svg)
    for colour, variable in VARIABLES.items():
        svg = svg.replace(colour, f"var({variable})")
    return svg


def _name_artists(figure: Any) -> None:
    """Give axes, curves, bars and texts of a Matplotlib `figure` names that its SVG
    keeps.

    An artist is read under its gid where it has one, or else under its label.
    """
    for number, axes in enumerate(figure.axes):
        axes.set_gid(f"axes-{number}")
        arrows = [
            text.arrow_patch
            for text in axes.texts
            if getattr(text, "arrow_patch", None)
        ]
        artists = [*axes.lines, *axes.collections, *axes.patches, *axes.texts, *arrows]
        for k, artist in enumerate(artists):
            artist.reading = artist.get_gid() or str(artist.get_label())
            artist.set_gid(f"item-{number}-{k}")


def readings(figure: Any) -> str:
    """Attribute `data-chart` of a figure's SVG: its axes, curves and cells as JSON for
    the page's script; empty if it has none.
    """
    all_axes = [_axes(axes, figure) for axes in figure.axes]
    drawn = [facts for facts in all_axes if facts["curves"] or facts["cells"]]
    text = json.dumps(drawn, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return f'data-chart="{escape(text)}"' if drawn else ""


def _axes(axes: Any, figure: Any) -> Facts:
    """Facts about one pair of axes for the page's script: place, limits, curves, cells,
    texts.
    """
    shared = axes.get_shared_x_axes().get_siblings(axes)
    (left, bottom), (right, top) = axes.bbox.min, axes.bbox.max
    x = _axis(axes.xaxis, axes.get_xlim())
    y = _axis(axes.yaxis, axes.get_ylim())
    drawn = (axes, figure, x, y)
    cells = chain(_bars(*drawn), _image_fields(*drawn), _mesh_fields(*drawn))
    return {
        "id": axes.get_gid(),
        "box": [*_svg_point(figure, left, top), *_svg_point(figure, right, bottom)],
        "x": x,
        "y": y,
        "equal": axes.get_aspect() == 1.0,
        "share": min(figure.axes.index(other) for other in shared),
        "curves": list(_curves(axes)),
        "cells": [cell for cell in cells if all(map(isfinite, cell[:4]))],
        "texts": [
            text for text in _texts(axes, figure) if all(map(isfinite, text[1:]))
        ],
    }


def _axis(axis: Any, limits: tuple[float, float]) -> Facts:
    """Facts about an axis for the page's script: limits, scale, name, unit, and its
    tick labels where they are words.
    """
    from matplotlib.ticker import FixedLocator

    label = axis.get_label_text()
    with_unit = re.fullmatch(r"(.*?)\s*\[(.*)\]", label, flags=re.S)
    name, unit = with_unit.groups() if with_unit else (label, "")
    ticks = [tick.get_text() for tick in axis.get_majorticklabels()]
    is_fixed = isinstance(axis.get_major_locator(), FixedLocator)
    # a letter in any tick label
    has_words = is_fixed and re.search(r"[a-z]", f"{ticks}")
    return {
        "limits": [float(value) for value in limits],
        "scale": axis.get_scale(),
        "name": " ".join(name.split()),
        "unit": unit,
        "words": (
            list(zip(map(float, axis.get_majorticklocs()), ticks, strict=False))
            if has_words
            else []
        ),
    }


def _svg_point(figure: Any, x: float, y: float) -> list[float]:
    """Point [pt] of the figure's SVG at a point [px] of its display."""
    scale = POINTS_PER_INCH / figure.dpi
    return [round(scale * x, 3), round(scale * (figure.bbox.height - y), 3)]


def _curves(axes: Any) -> Iterator[Facts]:
    """Yield facts about each named line and area of the axes: id, name, label, whether
    values are read from it.
    """
    from matplotlib.collections import FillBetweenPolyCollection

    bars = {
        patch
        for container in axes.containers
        for patch in getattr(container, "patches", ())
    }
    bands = {a for a in axes.collections if isinstance(a, FillBetweenPolyCollection)}
    for artist in [*axes.lines, *axes.collections, *axes.patches]:
        if not artist.reading.startswith("_") and artist not in bars:
            yield {
                "id": artist.get_gid(),
                "name": artist.reading,
                "label": str(artist.get_label()),
                "read": artist in list(axes.lines) or (artist in bands),
                "band": artist in bands,
            }


def _bars(axes: Any, figure: Any, x: Facts, y: Facts) -> Iterator[list[Any]]:
    """Yield each bar's cell across the axes: two corners x, y [pt], and a label with
    its value.
    """
    axes_box = axes.bbox
    for container in axes.containers:
        label = container.get_label()
        name = "" if label.startswith("_") else f"{label} "
        for patch in getattr(container, "patches", ()):
            box = patch.get_window_extent()
            along_x = (x, patch.get_x(), patch.get_width())
            along_y = (y, patch.get_y(), patch.get_height())
            is_named = not patch.reading.startswith("_")
            if is_named or container.orientation == "vertical":
                corners = ((box.x0, axes_box.y1), (box.x1, axes_box.y0))
                label = f"{_span_text(*along_x)}: {name}{_value_text(*along_y)}"
            else:
                corners = ((axes_box.x0, box.y1), (axes_box.x1, box.y0))
                label = f"{_span_text(*along_y)}: {name}{_value_text(*along_x)}"
            edges = (
                value for corner in corners for value in _svg_point(figure, *corner)
            )
            yield [*edges, patch.reading if is_named else label]


def _value_text(axis: Facts, start: float, size: float) -> str:
    """Text of a bar's value, or of both its ends where it does not start at zero."""
    ends = f"{_number(start)} to {_number(start + size)}" if start else _number(size)
    return f"{ends} {axis['unit']}".strip()


def _span_text(axis: Facts, start: float, size: float) -> str:
    """Text on the span of an `axis` that a bar covers: the nearest tick's word, or both
    ends.
    """
    if axis["words"]:
        return str(
            min(axis["words"], key=lambda word: abs(word[0] - start - 0.5 * size))[1]
        )
    return f"{_number(start)} to {_number(start + size)} {axis['unit']}".strip()


def _number(value: float) -> str:
    """Text of a `value` to four digits."""
    return f"{value:.4g}".replace("-", MINUS)


def _image_fields(axes: Any, figure: Any, x: Facts, y: Facts) -> Iterator[list[Any]]:
    """Yield each cell of an image with named rows and columns: two corners x, y [pt], a
    label.
    """
    for image in axes.images if x["words"] and y["words"] else ():
        for (i, j), value in np.ndenumerate(np.ma.filled(image.get_array(), np.nan)):
            if np.isfinite(value):
                corners = np.add([(j, i)], [[-0.5], [0.5]])
                label = f"{y['words'][i][1]} · {x['words'][j][1]}: {_number(value)}"
                yield [*_box(figure, axes.transData.transform(corners)), label]


def _mesh_fields(axes: Any, figure: Any, x: Facts, y: Facts) -> Iterator[list[Any]]:
    """Yield each cell of a mesh that is no colour scale: two corners x, y [pt], and a
    label.
    """
    if axes.get_label() == "<colorbar>":
        return
    to_display = axes.transData
    meshes = (mesh for mesh in axes.collections if hasattr(mesh, "get_coordinates"))
    for mesh in meshes:
        corners = mesh.get_coordinates()
        values = np.ma.filled(mesh.get_array(), np.nan)
        for (i, j), value in np.ndenumerate(values):
            ends = to_display.transform(corners[[i, i + 1], [j, j + 1]])
            # halfway as drawn, on a logarithmic axis too
            middle = to_display.inverted().transform(ends.mean(axis=0))
            where = ", ".join(map(_coordinate_text, (x, y), middle))
            text = _number(value) if np.isfinite(value) else "none"
            yield [*_box(figure, ends), f"{where}: {text}"]


def _coordinate_text(axis: Facts, value: float) -> str:
    """Text of a coordinate, with the name and unit of its axis."""
    return f"{axis['name'] or 'y'} {value:.3g} {axis['unit']}".strip()


def _box(figure: Any, ends: Array) -> list[float]:
    """Upper left and lower right corner x, y [pt] of a box with opposite corners `ends`
    (2, 2) [px].
    """
    (left, right), (low, high) = np.sort(ends, axis=0).T
    return [*_svg_point(figure, left, high), *_svg_point(figure, right, low)]


def _texts(axes: Any, figure: Any) -> Iterator[list[Any]]:
    """Yield each text placed in data coordinates: its id and position x, y [pt] in the
    SVG.
    """
    for text in axes.texts:
        anchor = np.asarray(getattr(text, "xy", text.get_position()))
        if (
            getattr(text, "xycoords", None) == "data"
            or text.get_transform() == axes.transData
        ):
            yield [
                text.get_gid(),
                *_svg_point(figure, *axes.transData.transform(anchor)),
            ]
