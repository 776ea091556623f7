"""Figures of the strip from the side: its motion, gripper paths, definitions, critical points."""

from typing import Any

import numpy as np

from cell.benchmark.figures import DASHES, PAGE_WIDTH, colour, desk, smooth, stiffness_colours
from cell.benchmark.results import Adaptation, CriticalPoints, Curve, Evolution, Laid, Results
from cell.benchmark.shape_parts import LEVEL_MOTION
from cell.benchmark.summary import FOLDED_HEIGHT
from cell.report.drawing import BLUE, GREEN, INK, MUTED, ORANGE, as_svg, canvas
from drivers.geometry import arc_lengths
from drivers.types import Array
from policies.path import circular, triangular

STRIP_LENGTH = 0.6  # m, of the paper's strip
ARROW_MM, ARC_RADIUS_MM, BASELINE_MM = 90.0, 40.0, 62.0  # drawn of action, angle, zero line


def level_figure(results: Results) -> str:
    """Figure (SVG) of the strip while the gripper moves horizontally, the first touch in bold."""
    found = evolution(results, LEVEL_MOTION)
    if found is None:
        return ""
    with canvas(PAGE_WIDTH, 2.7) as figure:
        axes = figure.add_subplot()
        desk(axes)
        _draw_shapes(axes, found, INK)
        start, end = _mm(found.shapes[0])[-1], _mm(found.path)[-1]
        axes.annotate(
            "", _offset_point(start, -110, 16), _offset_point(start, 0, 16), arrowprops=_arrow(BLUE)
        )
        axes.plot(*end, "o", color=BLUE, ms=5)
        _labels(axes, top=end[1] + 32)
        return as_svg(figure)


def policy_figure(results: Results) -> str:
    """Figure (SVG) of the strip under the learned policy, beside triangle and circle."""
    found = evolution(results, "feedback")
    if found is None:
        return ""
    with canvas(PAGE_WIDTH, 4.4) as figure:
        axes = figure.add_subplot()
        desk(axes)
        _draw_references(axes)
        _draw_shapes(axes, found, INK)
        axes.plot(*_mm(found.path).T, color=GREEN, lw=2.2, gid="gripper")
        axes.plot(*_mm(found.path)[-1], "o", color=GREEN, ms=5)
        _labels(axes)
        return as_svg(figure)


def adaptation_figure(results: Results) -> str:
    """Figure (SVG) of the learned policy's paths for strips of rising stiffness."""
    found = next((r for r in results.results if isinstance(r, Adaptation)), None)
    if found is None:
        return ""
    with canvas(PAGE_WIDTH, 3.6) as figure:
        axes = figure.add_subplot()
        desk(axes)
        _draw_references(axes)
        shades = stiffness_colours(len(found.paths))
        for path, c, shade in zip(found.paths, found.bending_lengths, shades, strict=True):
            name = f"{1e3 * c:.1f}"
            gid = f"bending length {name} mm"
            axes.plot(*_mm(path).T, color=shade, lw=1.5, label=name, gid=gid)
        axes.legend(title="bending length\n[mm]", title_fontsize=8.5, loc="upper left",
                    bbox_to_anchor=(1, 1))  # fmt: skip
        axes.get_legend().get_title().set_color(MUTED)
        _labels(axes)
        return as_svg(figure)


def measures_figure(results: Results) -> str:
    """Figure (SVG) of state and action in mid fold, and the lengths l1 and l2 at the touch."""
    found = evolution(results, "feedback")
    if found is None or found.touch_x is None or found.displacement is None:
        return ""
    with canvas(PAGE_WIDTH, 3.2) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw_state(left, found)
        _draw_lengths(right, found, found.touch_x, found.displacement)
        right.set_ylabel("")
        return as_svg(figure)


def evolution(results: Results, policy: str) -> Evolution | None:
    """Recorded shapes of the strip folded by `policy`; None where they are missing."""
    found = [r for r in results.results if isinstance(r, Evolution)]
    return next((r for r in found if r.policy == policy), None)


def _draw_shapes(axes: Any, found: Evolution, ink: str) -> None:
    for shape in found.shapes[:-1]:
        axes.plot(*_mm(shape).T, color=MUTED, lw=0.8, alpha=0.75, gid="strip")
    axes.plot(*smooth(_mm(found.shapes[-1])).T, color=ink, lw=2.2, gid="strip, first touch")
    if found.touch_x is not None:
        axes.plot(1e3 * found.touch_x, 0, "o", color=ORANGE, ms=5.5, zorder=6)
        axes.annotate("layers touch", (1e3 * found.touch_x, 0), (0, -16), ha="center",
                      textcoords="offset points", color=ORANGE, fontsize=8.5)  # fmt: skip


def _draw_references(axes: Any) -> None:
    for name, path in (
        ("triangular", triangular(STRIP_LENGTH)),
        ("circular", circular(STRIP_LENGTH)),
    ):
        axes.plot(*(1e3 * path.points).T, color=colour(name), lw=1, ls=DASHES, gid=name)
        place = 1e3 * path.at(0.82 * path.length)
        axes.annotate(name, place, (-5, 5), textcoords="offset points", ha="right",
                      color=colour(name), fontsize=8.5)  # fmt: skip


def _draw_state(axes: Any, found: Evolution) -> None:
    early = len(found.shapes) // 3  # the strip hangs freely, the layers are still apart
    shape = _mm(found.shapes[early])
    desk(axes)
    axes.plot(*shape.T, color=INK, lw=2, gid="strip")
    contact, gripper = 1e3 * found.contacts[early], shape[-1]
    axes.plot(contact, 0, "x", color=GREEN, ms=8, mew=2, zorder=6)
    axes.annotate("desk contact x", (contact, 0), (0, -16), textcoords="offset points",
                  ha="center", color=GREEN, fontsize=8.5)  # fmt: skip
    axes.plot(*gripper, "o", color=BLUE, ms=5)
    axes.annotate("gripper x, z", gripper, (9, -11), textcoords="offset points", fontsize=8.5)
    _draw_action(axes, gripper, found.headings[early])
    _labels(axes, top=345)
    axes.set_xlim(-30, 610)
    axes.set_title("state and action", fontsize=9, color=MUTED, loc="left")


def _draw_action(axes: Any, gripper: Array, phi: float) -> None:
    """Draw the direction `phi` [rad] of the gripper's motion, as an arrow and an angle."""
    along = ARROW_MM * np.array([np.cos(phi), np.sin(phi)])
    axes.annotate("", gripper + along, gripper, arrowprops=_arrow(BLUE))
    angles = np.linspace(0.0, phi, 40)
    arc = gripper + ARC_RADIUS_MM * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    axes.plot(*arc.T, color=BLUE, lw=0.8)
    level = gripper + np.array([[0, 0], [BASELINE_MM, 0]])
    axes.plot(*level.T, color=BLUE, lw=0.8, ls=DASHES)
    axes.annotate("φ", arc[len(arc) // 3], (5, 4), textcoords="offset points", color=BLUE)


def _draw_lengths(axes: Any, found: Evolution, touch_x: float, d: float) -> None:
    shape = smooth(np.array(found.shapes[-1]))
    s = arc_lengths(shape)
    upper = s[-1] - (d + touch_x)  # l1 = d + l2, and l2 is x where the lower layer lies flat
    layer = 1e3 * shape[s >= upper]
    desk(axes)
    axes.plot(*(1e3 * shape[s <= touch_x]).T, color=ORANGE, lw=2.6, gid="lower layer")
    axes.plot(*(1e3 * shape[(s >= touch_x) & (s <= upper)]).T, color=MUTED, lw=1.4, gid="fold")
    axes.plot(*layer.T, color=BLUE, lw=2.6, gid="upper layer")
    axes.annotate("l₂", (500 * touch_x, 0), (0, -14), textcoords="offset points",
                  color=ORANGE, ha="center")  # fmt: skip
    axes.annotate("l₁", layer[2 * len(layer) // 3], (-14, 0), textcoords="offset points",
                  color=BLUE)  # fmt: skip
    _labels(axes, top=345)
    axes.set_xlim(-30, 610)
    axes.set_title(f"d = l₁ − l₂ = {1e3 * d:+.1f} mm".replace("-", "−"), fontsize=9,
                   color=MUTED, loc="left")  # fmt: skip


def _labels(axes: Any, top: float | None = None) -> None:
    axes.set(xlabel="x  [mm]", ylabel="z  [mm]")
    axes.set_ylim(-34, top)


def _arrow(ink: str) -> dict[str, Any]:
    return {"arrowstyle": "-|>", "color": ink, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}


def _offset_point(place: Array, right: float, up: float) -> Array:
    return np.asarray(place + np.array([right, up]))


def _mm(curve: Curve) -> Array:
    return 1e3 * np.array(curve, dtype=np.float64)


FOLD_WIDTH = 130.0  # mm, drawn of a folded strip
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
    h = 1e3 * FOLDED_HEIGHT * np.array(points.bending_lengths)
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


def folded_figure(results: Results) -> str:
    """Figure (SVG) of folded shapes, ends aligned, and their heights over bending length."""
    laid = [r for r in results.results if isinstance(r, Laid)]
    if not laid:
        return ""
    with canvas(PAGE_WIDTH, 2.3) as figure:
        left, right = figure.subplots(1, 2, width_ratios=[1.7, 1])
        shades = stiffness_colours(len(laid))
        for fold, shade in zip(laid, shades, strict=True):
            _draw_laid(left, right, fold, shade)
        c = np.array([0.0, 1.08e3 * max(fold.bending_length for fold in laid)])
        h = FOLDED_HEIGHT * c
        right.plot(c, h, color=MUTED, lw=1)
        right.annotate(f"{FOLDED_HEIGHT} c", (c[1], h[1]), (-8, -2),
                       textcoords="offset points", ha="right", color=MUTED, fontsize=8)  # fmt: skip
        left.set(xlabel="x from the fold's end  [mm]", ylabel="z  [mm]", aspect="equal")
        left.set_ylim(-1.5, None)
        right.set(xlabel="bending length c  [mm]", ylabel="height h  [mm]")
        return as_svg(figure)


def _draw_laid(shapes: Any, heights: Any, fold: Laid, shade: Any) -> None:
    """Draw the end of a folded strip, and its height over its bending length."""
    shape = 1e3 * smooth(np.array(fold.shape))
    shape[:, 0] -= shape[:, 0].max()
    near = shape[:, 0] > -FOLD_WIDTH
    h, c = shape[:, 1].max(), 1e3 * fold.bending_length
    shapes.plot(*shape[near].T, color=shade, lw=1.8, gid=f"bending length {c:.1f} mm")
    heights.plot(c, h, "o", color=shade, ms=5, gid="folded strip")
    heights.annotate(f"{h:.1f}", (c, h), (6, -6),
                     textcoords="offset points", color=shade, fontsize=8)  # fmt: skip
