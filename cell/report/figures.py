"""Figures of a run: strip and signals over time, and the policy's predictions."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from cell.record.columns import FARTHEST_HAND, Sights, Ticks
from cell.record.events import Outlook
from cell.record.run import Run, read_broken_run
from cell.record.truth import read_truth
from cell.report.drawing import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    PURPLE,
    RULE,
    as_svg,
    canvas,
)
from cell.report.overlay import SHOWN_IMAGES, Silhouette, evenly_chosen, fold_tips
from cell.report.words import PARAMETERS
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
from drivers.base.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = 6  # runs of which a page on many shows each
CURVES = 26  # profiles that are drawn, of all that were measured
NAMED_SHARE = 0.05  # of the run's time, from which on a state has room for its name
LEFT, RIGHT = 0.075, 0.995  # shares of the figure's width between which its signals lie
NOTE: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8.5}
TIME_COLOURS = ["#8fc6b4", "#3f8fc4", "#6a4fb3", "#b0428f"]
STATE_SHADES = read_yaml(Path(__file__).with_name("states.yaml"))
READING = frozenset({"LIFT", "FOLD", "TOUCHED"})  # states in which images are read
PANELS = {
    "displacement": ("predicted d  [mm]", 1e3, ORANGE),
    "bending_length": (f"{PARAMETERS['bending_length']}  [mm]", 1e3, BLUE),
    "retardation_time": (f"{PARAMETERS['retardation_time']}  [ms]", 1e3, BLUE),
    "yield_curvature": (f"{PARAMETERS['yield_curvature']}  [1/m]", 1.0, BLUE),
}
# mm, displacements shown to either side of 0, and beyond them
HALF_HEIGHT, MARGIN = 40.0, 1.0


class DrawnRun(Run):
    """Recorded run that can be drawn; of a run on the twin it also has the
    true motion.
    """

    __slots__ = ()

    @classmethod
    def of(cls, run: Run) -> Self:
        """Copy of `run` that can be drawn."""
        return cls(**{field.name: getattr(run, field.name) for field in fields(run)})

    @property
    def truth(self) -> Mapping[str, Any] | None:
        """True motion of the simulated strip [m, s], which only the twin knows; None
        for other runs.
        """
        return read_truth(self.folder)

    def plot(self) -> "Figure":
        """Figure of the strip and the gripper's path, above the signals over time."""
        with canvas(8.4, 7.6) as figure:
            side, along, above = figure.subplots(3, 1, height_ratios=[2.4, 1, 1])
            side.set_aspect("equal")
            _draw_side(side, self)
            _draw_signals(along, above, self)
        drawn: Figure = figure
        return drawn


def strip_figure(run: Run, outlines: Sequence[Silhouette] = ()) -> str:
    """Figure (SVG) of a run in the strip's plane: profiles over time, gripper path,
    `outlines`.
    """
    with canvas(8.4, 4.5, layout=None) as figure:
        axes = figure.add_axes((0.066, 0.1, 0.85, 0.885), aspect="equal", anchor="W")
        _draw_outlines(axes, evenly_chosen(outlines, SHOWN_IMAGES))
        _draw_side(axes, run)
        axes.set_ylim(-38, None)
        axes.spines["bottom"].set_visible(False)
        return as_svg(figure)


def drawings(folders: Sequence[Path]) -> list[tuple[str, str, str]]:
    """Names, figures (SVG) and what is not recorded of the runs in the first DRAWN
    `folders` of a strip.
    """
    drawn = []
    for folder in folders[:DRAWN]:
        try:
            run = read_broken_run(folder)
        except ConfigurationError:  # which a check says
            continue
        ticks = run.ticks
        recorded = {
            "commands": np.isfinite(ticks.x_cmd).any(),
            "desk contacts": len(ticks.contacts()[0]),
            "midlines": len(run.profile.t),
            "forces": np.isfinite(ticks.f_x).any(),
            "touch of the layers": run.result is not None and run.result.l2 is not None,
        }
        missing = [what for what, is_there in recorded.items() if not is_there]
        figure = strip_figure(run) if ticks.t.size else ""
        drawn.append((run.name, figure, ", ".join(missing)))
    return drawn


def signals_figure(run: Run) -> str:
    """Figure (SVG) of contact, fold tip, gripper and gap over time, above the run's
    states.
    """
    touch = None if run.result is None else run.result.t_layer_touch
    with canvas(8.4, 5.2, layout=None) as figure:
        figure.subplots_adjust(LEFT, 0.085, RIGHT, 0.995, hspace=0.28)
        lanes, along, above = figure.subplots(
            3, 1, sharex=True, height_ratios=[0.3, 2, 2]
        )
        _draw_lanes(lanes, run.ticks)
        _draw_signals(along, above, run)
        if touch is not None:
            for axes in (along, above):
                axes.axvline(touch, color=ORANGE, lw=1, ls=(0, (3, 2)))
        figure.align_ylabels([along, above])
        return as_svg(figure)


def _draw_side(axes: Any, run: Run) -> None:
    """Draw a `run` in the strip's plane: profiles, desk, path, touch."""
    _draw_profiles(axes, evenly_chosen(run.profile.curves(), CURVES))
    _draw_desk(axes, run)
    _draw_path(axes, run.ticks)
    _draw_touch(axes, run)
    axes.set(xlabel="x  [mm]", ylabel="z  [mm]")


def _draw_signals(along: Any, above: Any, run: Run) -> None:
    """Draw the coordinates x and z over time, each on axes of its own."""
    sights = run.sights()
    _draw_coordinate(along, run.ticks, sights, "x")
    _draw_coordinate(above, run.ticks, sights, "z")
    along.set_ylabel("along the strip  [mm]")
    above.set(xlabel="t  [s]", ylabel="above the desk  [mm]")


def _draw_profiles(axes: Any, curves: Sequence[tuple[float, Array]]) -> None:
    """Draw profiles (n, 2) [m] with their times [s] in colours that a bar explains."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    if not curves:
        return
    colours = LinearSegmentedColormap.from_list("time", TIME_COLOURS)
    first, last = curves[0][0], curves[-1][0]
    for t, points in curves:
        shade = colours((t - first) / max(last - first, 1e-9))
        # an outlier would fill the page
        near = 1e3 * points[(np.abs(points) < FARTHEST_HAND).all(axis=1)]
        axes.plot(*near.T, color=shade, lw=1.1, alpha=0.85, gid=f"strip, {t:.2f} s")
    scale = ScalarMappable(Normalize(first, last), colours)
    bar = axes.figure.colorbar(scale, cax=axes.inset_axes((1.01, 0.2, 0.014, 0.6)))
    bar.outline.set_visible(False)
    bar.set_label("t  [s]")


def _draw_outlines(axes: Any, outlines: Sequence[Silhouette]) -> None:
    """Draw outlines of the strip in its plane, as seen while the fold is laid and after
    it.
    """
    drawn_states: set[str] = set()
    for outline in outlines:
        state = outline.state
        label = None if state in drawn_states else state
        drawn_states.add(state)
        colour = GREEN if state == "LAY" else PURPLE
        axes.fill(
            *(1e3 * outline.plane).T,
            fc=colour,
            ec=colour,
            alpha=0.5,
            lw=0.8,
            label=label,
        )
    if drawn_states:
        axes.legend(loc="upper right", handlelength=1.2)


def _draw_desk(axes: Any, run: Run) -> None:
    """Draw the desk, the measured desk contacts and the fixed edge."""
    axes.axhline(0, color=MUTED, lw=0.8)
    contact = 1e3 * run.ticks.contacts()[1]
    axes.plot(
        contact, np.full_like(contact, -6), "|", color=BLUE, ms=5, mew=0.5, alpha=0.5
    )
    axes.plot(0, 0, "s", color=INK, ms=4, clip_on=False)
    axes.annotate("fixed edge", (0, 0), (4, -14), **NOTE)


def _draw_path(axes: Any, ticks: Ticks) -> None:
    """Draw the commanded and the measured path of the gripper."""
    size = ticks.t.size
    commanded = 1e3 * np.stack([ticks.x_cmd, ticks.z_cmd])
    axes.plot(*commanded, color=MUTED, lw=0.8, ls=(0, (1, 2)), gid="commanded")
    measured = 1e3 * np.stack([ticks.x, ticks.z])
    axes.plot(*measured, color=INK, lw=1.5, gid="gripper")

    if size:
        axes.plot(*measured[:, -1], "o", mfc=PAPER, mec=INK, ms=5)
        early = measured[:, size // 5]
        axes.annotate("gripper", early, (6, 6), **NOTE)


def _draw_touch(axes: Any, run: Run) -> None:
    """Mark the place at which the layers touched."""
    l2 = None if run.result is None else run.result.l2
    if l2 is None:
        return
    touch = (1e3 * l2, 0)
    axes.plot(*touch, "o", color=ORANGE, ms=6, zorder=5)
    axes.annotate("layers touch", touch, (0, -18), ha="center", color=ORANGE, **NOTE)


def _draw_lanes(axes: Any, ticks: Ticks) -> None:
    """Draw a bar over time for each state of the run, named where there is room."""
    t = ticks.t
    axes.set_axis_off()
    first = 0
    for state, rows in groupby(ticks.state):
        following = first + len(list(rows))
        start, end = t[first], t[min(following, t.size - 1)]
        first = following
        shade = STATE_SHADES.get(state, RULE)
        axes.barh(0, end - start, left=start, height=1, color=shade, lw=0, gid=state)
        if end - start > NAMED_SHARE * (t[-1] - t[0]):
            middle = 0.5 * (start + end)
            axes.text(
                middle, 0, state, ha="center", va="center", fontsize=8, color="#20262d"
            )


def _draw_coordinate(
    axes: Any, ticks: Ticks, sights: Sights, axis: Literal["x", "z"]
) -> None:
    """Draw x of gripper, desk contact and fold tip over time, or z of gripper and fold
    tip and the gap of the layers.
    """
    axes.plot(ticks.t, 1e3 * getattr(ticks, axis), color=INK, label=f"gripper {axis}")
    if axis == "x":
        visible = np.isfinite(ticks.contact_x)
        if visible.any():
            contact = 1e3 * ticks.contact_x[visible]
            axes.plot(
                ticks.t[visible], contact, ".", color=BLUE, ms=2.2, label="contact x"
            )
    tips = 1e3 * fold_tips(sights, ticks)[:, "xz".index(axis)]
    lines = [(tips, GREEN, f"fold tip {axis}")]
    lines += [(1e3 * sights.gap, ORANGE, "gap of the layers")] if axis == "z" else []
    for values, colour, name in lines:
        if np.isfinite(values).any():
            axes.plot(sights.stamp, values, color=colour, lw=1, label=name)
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=3,
        handlelength=1.2,
        borderaxespad=0,
    )


def image_ages(run: Run) -> Array:
    """Ages (n,) [s] of the newest image in those control cycles of a `run` that use
    images.
    """
    ticks = run.ticks
    reading = np.array([state in READING for state in ticks.state], dtype=bool)
    rows = reading if reading.any() else np.ones(ticks.t.size, dtype=bool)
    return ticks.image_age[rows & np.isfinite(ticks.image_age)]


def outlook_figure(run: Run, outlook: Outlook) -> str:
    """Figure (SVG) of the predicted displacement and strip parameters over time, with
    one sigma.
    """
    with canvas(8.4, 4.2, layout=None) as figure:
        figure.subplots_adjust(LEFT, 0.105, RIGHT, 0.985, 0.19, 0.07)
        grid = figure.subplots(2, 2, sharex=True)
        panels = dict(zip(PANELS, grid.flat, strict=True))
        for name, axes in panels.items():
            _draw_prediction(axes, outlook, name)
        measured = None if run.result is None else run.result.displacement
        if measured is not None:
            panels["displacement"].axhline(
                1e3 * measured, color=INK, lw=1, ls=(0, (1, 2))
            )
        for axes in grid[1]:
            axes.set_xlabel("t  [s]")
        return as_svg(figure)


def _draw_prediction(axes: Any, outlook: Outlook, name: str) -> None:
    """Draw the predicted quantity `name` of PANELS over time, with its band of one
    sigma.
    """
    label, scale, colour = PANELS[name]
    value, low, high = scale * outlook.band(name)
    axes.fill_between(
        outlook.t, low, high, color=colour, alpha=0.22, lw=0, gid="one sigma"
    )
    axes.plot(outlook.t, value, color=colour, lw=1.2, gid=label.partition("  [")[0])
    axes.set_ylabel(label)
    if name == "displacement":
        axes.axhline(0, color=MUTED, lw=0.6)
        largest = np.nanmax(np.abs([low, high]), initial=0.0)
        limit = min(HALF_HEIGHT, largest) + MARGIN
        axes.set_ylim(-limit, limit)
