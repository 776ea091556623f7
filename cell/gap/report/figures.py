"""Figures of the report, as SVG text, and the runs replayed for them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import FuncNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from cell.gap.diagnosis.lack_of_fit import Bin
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import requests
from cell.gap.report.sentence import motion
from cell.gap.subject.scene import Scene
from cell.gap.subject.subject import Quantity, Subject
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import CandidateEntry
from cell.report.drawing import BLUE, INK, MUTED, ORANGE, RULE, as_svg, canvas
from drivers.types import Array

FAINT_COLOUR, COLOUR_BEFORE, COLOUR_AFTER = MUTED, ORANGE, BLUE
CHARACTER = 0.075  # inch, width of a letter of a tick's label
COLUMN = 0.34  # inch, width of a column of the heat map
MOST_BARS = 14  # candidates in a figure


@dataclass(frozen=True, slots=True)
class Replay:
    """A run as measured and as simulated; `after` is None where no effect was accepted."""

    name: str
    held_out: bool
    measured: Scene
    before: Scene | None
    after: Scene | None


def folds(shapes: Mapping[str, Array]) -> str:
    """Figure (SVG) of strips where their layers touch: midlines (n, 2) [m] by name."""
    with canvas(7.0, 2.2) as figure:
        axes = figure.add_subplot(aspect="equal", anchor="W")
        axes.axhline(0, color=MUTED, lw=0.8)
        axes.set_prop_cycle(color=[COLOUR_BEFORE, COLOUR_AFTER])
        for name, points in shapes.items():
            axes.plot(*(1e3 * points).T, label=name)
        axes.set(xlabel="x  [mm]", ylabel="z  [mm]")
        _legend_above(figure, axes)
        return as_svg(figure)


def replay(findings: Findings, *, held_out_only: bool = False) -> Iterator[Replay]:
    """Simulate runs under the refitted base and the accepted model, held-out ones first."""
    subject, shown = findings.subject, findings.unseen
    pairs = [(True, shown.before, shown.after if shown.changed else None)]
    if not held_out_only:
        base, best = findings.base.estimate, findings.accepted.estimate
        pairs.append((False, base, best if best.model.effects else None))
    for held_out, before, after in pairs:
        runs = before.evidence.runs
        scenes_before = _scenes(subject, before)
        scenes_after = [None] * len(runs) if after is None else _scenes(subject, after)
        for run, old, new in zip(runs, scenes_before, scenes_after, strict=True):
            yield Replay(run.name, held_out, subject.draw_measured(run), old, new)


def _scenes(subject: Subject, estimate: Estimate) -> Sequence[Scene | None]:
    asked = requests(estimate.model, estimate.evidence.runs, estimate.point)
    return subject.draw_simulated(asked)


def blank(
    width: float, height: float, rows: int = 1, columns: int = 1
) -> tuple[Figure, list[Axes]]:
    """Empty figure of `width` by `height` [inch] with rows by columns of plain axes."""
    with canvas(width, height) as figure:
        axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axis in axes:
        axis.tick_params(colors=INK, labelsize=8)
        axis.grid(visible=False)
    return figure, axes


def heat_map(places: Sequence[Bin]) -> str:
    """Heat map of the strength of every bin: rows channel, zone and phase, columns conditions."""
    rows = sorted({(p.channel, p.zone, p.phase) for p in places})
    columns = list(dict.fromkeys(sorted(p.condition for p in places)))
    grid = np.full((len(rows), len(columns)), np.nan)
    significant = np.zeros_like(grid, dtype=bool)
    for p in places:
        at = rows.index((p.channel, p.zone, p.phase)), columns.index(p.condition)
        grid[at], significant[at] = abs(p.z), p.p < 0.05
    figure, axes = blank(max(5.0, 1.8 + COLUMN * len(columns)), max(2.0, 0.9 + 0.3 * len(rows)))
    axis = axes[0]
    highest = max(9.0, float(np.nanmax(grid)))
    scale = FuncNorm((np.log1p, np.expm1), 0.0, highest)
    image = axis.imshow(np.ma.masked_invalid(grid), cmap="YlOrRd", aspect="auto", norm=scale)
    axis.set_yticks(range(len(rows)), [" · ".join(row) for row in rows])
    words = [motion(condition) for condition in columns]
    axis.set_xticks(range(len(words)), words, **_slant_labels(words, COLUMN))
    for i, j in zip(*np.nonzero(significant), strict=True):
        axis.plot(j, i, "o", ms=2.5, color=INK)
    _add_colour_bar(figure, axis, image, highest)
    axis.set_xlabel("condition", fontsize=8)
    return as_svg(figure)


def _add_colour_bar(figure: Figure, axis: Axes, image: AxesImage, highest: float) -> None:
    """Add a colour bar with a few round ticks up to `highest` [sigma]."""
    bar = figure.colorbar(image, ax=axis, pad=0.01)
    steps = (0, 1, 3, 10, 30) if highest < 99.0 else (0, 10, 100, 1000, 10000)
    ticks = [z for z in steps if z <= highest]
    bar.set_ticks(ticks, labels=[str(z) for z in ticks])
    bar.set_label("sigma beyond noise", fontsize=8, color=INK)
    bar.ax.tick_params(labelsize=8, colors=INK)


def _slant_labels(labels: Sequence[str], width: float) -> dict[str, Any]:
    """Rotation of labels below columns of `width` [inch] that keeps them apart."""
    if CHARACTER * max(map(len, labels), default=0) <= width:
        return {}
    return {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}


def candidate_bars(rows: Sequence[CandidateEntry], accepted: str) -> str:
    """Bars of the nats that candidates gain on runs left out, with standard errors over runs."""
    shown = list(rows)[:MOST_BARS][::-1]  # bars stand from the bottom up
    figure, axes = blank(7.0, 0.6 + 0.27 * len(shown))
    axis = axes[0]
    least = -0.25 * max([1.0, *(row.elpd_gain for row in shown)])  # longer losses are cut there
    gains = [max(row.elpd_gain, least) for row in shown]
    colours = [COLOUR_AFTER if row.name == accepted else FAINT_COLOUR for row in shown]
    axis.barh(range(len(shown)), gains, color=colours, height=0.7)
    scatter = [row.se if row.elpd_gain > least else 0.0 for row in shown]
    axis.errorbar(gains, range(len(shown)), xerr=scatter, fmt="none", ecolor=INK, elinewidth=0.8)
    for i, row in enumerate(shown):
        if row.elpd_gain < least:
            axis.text(least, i, f"{row.elpd_gain:.0f} ", ha="right", va="center", fontsize=7)
    ends = [gain + min(row.se, abs(gain)) for gain, row in zip(gains, shown, strict=True)]
    highest = max(1.0, *ends)
    axis.set_xlim(1.6 * least if min(gains) < 0.0 else -0.02 * highest, 1.05 * highest)
    axis.axvline(0.0, color=INK, lw=0.8)
    axis.set_yticks(range(len(shown)), [row.name for row in shown])
    axis.set_xlabel("gain over the refitted base on runs left out [nats]", fontsize=8)
    return as_svg(figure)


def residual_traces(
    before: Estimate, after: Estimate | None, run: int, quantities: dict[str, Quantity]
) -> str:
    """Figure of measured minus simulated over time in a held-out run, before and perhaps after."""
    s = before.evidence.runs[run].samples
    rows = [np.flatnonzero(s.series == number) for number in np.unique(s.series)]
    rows = [mine[np.argsort(s.t[mine])] for mine in rows if len(mine) > 1]
    if not rows:
        return ""
    shown = [(before, COLOUR_BEFORE, "before")]
    if after is not None:
        shown.append((after, COLOUR_AFTER, "after"))
    figure, axes = blank(7.5, 0.8 + 1.35 * len(rows), rows=len(rows))
    times = s.t[np.concatenate(rows)]
    for axis, mine in zip(axes, rows, strict=True):
        axis.set_xlim(float(times.min()), float(times.max()))
        quantity = quantities[str(s.quantity[mine][0])]
        band = 2.0 * quantity.factor * s.reading[mine]
        axis.fill_between(s.t[mine], -band, band, color=RULE, lw=0, gid="2 sigma of the noise")
        zones = set(s.zone[mine])
        name = f"{s.channel[mine][0]}{f' {zones.pop()}' if len(zones) == 1 else ''}"
        for estimate, colour, word in shown:
            axis.plot(s.t[mine], quantity.factor * estimate.raw[run].mean[mine], color=colour,
                      lw=1.2, label=word, gid=f"{name}, {word}")  # fmt: skip
        axis.set_ylabel(f"{name}\n[{quantity.unit}]", fontsize=8)
        axis.sharex(axes[0])
        axis.axhline(0.0, color=INK, lw=0.5)
    axes[-1].set_xlabel("time [s]", fontsize=8)
    _legend_above(figure, axes[0])
    return as_svg(figure)


def midlines(run: Replay) -> str:
    """Figure of the lifted part of a run's curve at four moments: measured, before and after."""
    measured = run.measured.curve
    if measured is None or not len(measured.t):
        return ""
    end = min((t for t, _ in run.measured.events), default=float(measured.t[-1]))
    last = max(0, int(np.searchsorted(measured.t, end)) - 1)
    chosen = np.unique(np.linspace(0, last, 5).round().astype(int)[1:])  # not the start
    figure, axes = blank(8.0, 6.2, rows=(len(chosen) + 1) // 2, columns=2)
    for axis, k in zip(axes, chosen, strict=False):
        _midline(axis, run, int(k))
        axis.set_title(f"{measured.t[k]:.2f} s", fontsize=8)
    for axis in axes[len(chosen) :]:
        axis.set_visible(False)
    _legend_above(figure, axes[0])
    return as_svg(figure)


def _midline(axis: Axes, run: Replay, k: int) -> None:
    """Draw image number `k`, as far as its midline was seen."""
    points = 1e3 * run.measured.curve.points[k] if run.measured.curve else np.zeros((1, 2))
    axis.plot(*points.T, "o", ms=3.5, color=INK, alpha=0.35, mew=0, label="measured")
    for scene, colour, word in (
        (run.before, COLOUR_BEFORE, "before"),
        (run.after, COLOUR_AFTER, "after"),
    ):
        if scene is not None and scene.curve is not None:
            axis.plot(*(1e3 * scene.curve.points[k]).T, color=colour, lw=1.2, label=word)
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    half = 0.55 * max(right - left, high - low) + 5.0
    axis.set_xlim(0.5 * (left + right) - 1.5 * half, 0.5 * (left + right) + 1.5 * half)
    axis.set_ylim(0.5 * (low + high) - half, 0.5 * (low + high) + half)
    axis.set_aspect("equal")
    axis.set_xlabel("x [mm]", fontsize=8)
    axis.set_ylabel("z [mm]", fontsize=8)


def _legend_above(figure: Figure, axis: Axes) -> None:
    """Put the legend of `axis` above all axes, where it covers nothing."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(
        handles, labels, fontsize=8, frameon=False, ncols=3, loc="outside upper left",
        labelcolor=INK,
    )  # fmt: skip


def run_bars(names: Sequence[str], before: Array, after: Array | None) -> str:
    """Bars of the excess gap (R,) [noise] of each held-out run, before and, if given, after."""
    figure, axes = blank(max(4.0, 1.0 + 0.7 * len(names)), 2.3)
    axis, at = axes[0], np.arange(len(names))
    highest = float(before.max())
    if after is None:
        axis.bar(at, before, 0.38, color=COLOUR_BEFORE)
    else:
        axis.bar(at - 0.2, before, 0.38, color=COLOUR_BEFORE, label="before")
        axis.bar(at + 0.2, after, 0.38, color=COLOUR_AFTER, label="after")
        highest = max(highest, float(after.max()))
        _legend_above(figure, axis)
    axis.set_xticks(at, names, **_slant_labels(names, 0.7))
    axis.set_ylim(0.0, 1.05 * max(highest, 1e-9))
    axis.set_ylabel("excess gap [noise]", fontsize=8)
    return as_svg(figure)
