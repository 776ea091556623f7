"""Figures of a fit's report, as SVG text, and the runs simulated again for them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import FuncNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cell.gap.diagnosis.lack_of_fit import Bin
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.model import requests
from cell.gap.report.sentence import motion_name
from cell.gap.subject.subject import Quantity, Samples, Scene, Subject
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from cell.report.drawing import BLUE, INK, MUTED, ORANGE, RULE, as_svg, canvas
from cell.report.words import plain
from drivers.base.types import Array

COLOUR_BEFORE, COLOUR_AFTER = ORANGE, BLUE
COLUMN = 0.34  # inch, width of a column of the heat map
HEAT_TICKS = (0, 1, 3, 10, 30, 100, 1000, 10000)  # sigma, on its logarithmic scale


@dataclass(frozen=True, slots=True)
class RunScenes:
    """Run as measured and simulated: scenes by the keys `measured`, `before` and
    `after`.

    `after` is left out where no effect was accepted, and a simulation where it has no
    motion.
    """

    name: str
    held_out: bool
    scenes: dict[str, Scene]

    @property
    def measured(self) -> Scene:
        """Drawing of the run as it was measured."""
        return self.scenes["measured"]


class DrawnVerdict(Verdict):
    """Verdict that can be drawn."""

    def plot(self) -> Figure:
        """Figure of the residuals of held-out runs by quantity, before and after, in
        units of their noise.
        """
        noise = {key: value for key, value in self.gap.floor.items() if value}
        sides = {"before": self.gap.before, "after": self.gap.after}
        sizes = {
            word: np.array([side[key] / level for key, level in noise.items()])
            for word, side in sides.items()
        }
        names = [*map(plain, noise)]
        drawn: Figure
        with canvas(6.0, 1.4 + 0.5 * len(noise)) as drawn:
            label = "rms of held-out runs, in units of their noise"
            axis = _bars(drawn, names, sizes, label)
            axis.axvline(1.0, color=INK, lw=0.8, label="noise")
            _legend_above(drawn, axis)
        return drawn


def folds(shapes: Mapping[str, Array]) -> str:
    """Figure (SVG text) of folded strips at the touch of layers: midlines (n, 2) [m] by
    name.
    """
    with canvas(7.0, 2.2) as figure:
        axes = figure.add_subplot(aspect="equal", anchor="W")
        axes.axhline(0, color=MUTED, lw=0.8)
        axes.set_prop_cycle(color=[COLOUR_BEFORE, COLOUR_AFTER])
        for name, points in shapes.items():
            axes.plot(*(1e3 * points).T, label=name)
        axes.set(xlabel="x  [mm]", ylabel="z  [mm]")
        _legend_above(figure, axes)
        return as_svg(figure)


def replay(findings: Findings) -> Iterator[RunScenes]:
    """Simulate runs with the base and the accepted model for drawings, held-out runs
    first.
    """
    subject, accepted = findings.subject, findings.accepted
    fitted = {"before": findings.base.estimate}
    if accepted.effects:
        fitted["after"] = accepted.estimate
    yield from replay_runs(subject, findings.held_out_fits.by_key, held_out=True)
    yield from replay_runs(subject, fitted, held_out=False)


def replay_runs(
    subject: Subject, fits: Mapping[str, FitEstimate], *, held_out: bool
) -> Iterator[RunScenes]:
    """Simulate the runs of `fits`, one fit each for the keys `before` and `after`."""
    drawn = {
        word: subject.draw_simulated(requests(fit.model, fit.runs, fit.point))
        for word, fit in fits.items()
    }
    for i, run in enumerate(fits["before"].runs):
        simulated = {word: scenes[i] for word, scenes in drawn.items()}
        scenes = {"measured": subject.draw_measured(run), **simulated}
        yield RunScenes(
            run.name, held_out, {word: s for word, s in scenes.items() if s}
        )


def heat_map(places: Sequence[Bin]) -> str:
    """Figure (SVG text) of |z| [sigma] by bin: channel, zone, phase in rows, by
    conditions.
    """
    cells = {((p.channel, p.zone, p.phase), p.condition): p for p in places}
    rows, columns = (sorted({*words}) for words in zip(*cells, strict=True))
    grid = np.full((len(rows), len(columns)), np.nan)
    significant = []
    for (row, column), place in cells.items():
        i, j = rows.index(row), columns.index(column)
        grid[i, j] = abs(place.z)
        if place.p < 0.05:
            significant.append((j, i))
    highest = max(9.0, np.nanmax(grid))
    scale = FuncNorm((np.log1p, np.expm1), 0.0, highest)
    with canvas(
        max(5.0, 1.8 + COLUMN * len(columns)), max(2.0, 0.9 + 0.3 * len(rows))
    ) as figure:
        axis = figure.add_subplot()
        axis.grid(visible=False)
        image = axis.imshow(
            np.ma.masked_invalid(grid), cmap="YlOrRd", aspect="auto", norm=scale
        )
        axis.set_yticks(range(len(rows)), [" · ".join(row) for row in rows])
        axis.set_xticks(
            range(len(columns)),
            [motion_name(condition) for condition in columns],
            rotation=40,
            ha="right",
            rotation_mode="anchor",
        )
        for at in sorted(significant, key=itemgetter(1, 0)):
            axis.plot(*at, "o", ms=2.5, color=INK)
        ticks = [z for z in HEAT_TICKS if z <= highest]
        figure.colorbar(
            image, ax=axis, pad=0.01, ticks=ticks, label="sigma beyond noise"
        )
        axis.set_xlabel("condition")
        return as_svg(figure)


def residual_traces(
    fits: Mapping[str, FitEstimate], run: int, quantities: Mapping[str, Quantity]
) -> str:
    """Figure (SVG text) of residuals over time in run number `run`, by key of
    `fits`.
    """
    samples = fits["before"].runs[run].samples
    by_series = [
        np.flatnonzero(samples.series == number) for number in np.unique(samples.series)
    ]
    by_series = [
        rows[np.argsort(samples.t[rows])] for rows in by_series if len(rows) > 1
    ]
    if not by_series:
        return ""
    means = {word: fit.raw[run].mean for word, fit in fits.items()}
    times = samples.t[np.concatenate(by_series)]
    with canvas(7.5, 0.8 + 1.35 * len(by_series)) as figure:
        axes = figure.subplots(len(by_series), sharex=True, squeeze=False)[:, 0]
        for axis, rows in zip(axes, by_series, strict=True):
            _residual_trace(axis, samples, rows, means, quantities)
        axes[0].set_xlim(times.min(), times.max())
        axes[-1].set_xlabel("time [s]")
        _legend_above(figure, axes[0])
        return as_svg(figure)


def _residual_trace(
    axis: Axes,
    samples: Samples,
    rows: NDArray[np.int64],
    means: Mapping[str, Array],
    quantities: Mapping[str, Quantity],
) -> None:
    """Draw residual `means` (n,) [SI] by fit in one series over a band of 2 sigma
    noise.
    """
    quantity = quantities[str(samples.quantity[rows][0])]
    t = samples.t[rows]
    band = 2.0 * quantity.factor * samples.reading[rows]
    axis.fill_between(t, -band, band, color=RULE, lw=0, gid="2 sigma of the noise")
    zones = set(samples.zone[rows])
    name = f"{samples.channel[rows][0]}{f' {zones.pop()}' if len(zones) == 1 else ''}"
    for (word, mean), colour in zip(
        means.items(), (COLOUR_BEFORE, COLOUR_AFTER), strict=False
    ):
        shown = quantity.factor * mean[rows]
        axis.plot(t, shown, color=colour, lw=1.2, label=word, gid=f"{name}, {word}")
    axis.set_ylabel(f"{name}\n[{quantity.unit}]")
    axis.axhline(0.0, color=INK, lw=0.5)


@dataclass(frozen=True, slots=True)
class Worst:
    """Moment of a run at which the model before is farthest from the curve measured.

    `t` [s] is that of image number `image`, `off` the rms distances [m] of the measured
    points from the simulated curves by their key.
    """

    run: RunScenes
    image: int
    t: float
    off: Mapping[str, float]


def worst_moment(runs: Sequence[RunScenes]) -> Worst | None:
    """Worst moment of `runs`; None where they have no curve."""
    found = None
    for run in runs:
        curve, before = run.measured.curve, run.scenes.get("before")
        if not (curve and len(curve.t) and before and before.curve):
            continue
        pairs = zip(curve.points, before.curve.points, strict=True)
        distances = [_distance(points, line) for points, line in pairs]
        image = int(np.argmax(distances))
        if found and found.off["before"] >= distances[image]:
            continue
        off = {
            key: _distance(curve.points[image], drawn.curve.points[image])
            for key, drawn in run.scenes.items()
            if key != "measured" and drawn.curve
        }
        found = Worst(run, image, curve.t[image], off)
    return found


def _distance(points: Array, line: Array) -> float:
    """Rms distance [m] of `points` (k, 2) from the nodes (n, 2) of a curve."""
    apart = np.hypot(*(points[:, None] - line[None]).transpose(2, 0, 1))
    return float(np.sqrt(np.mean(apart.min(axis=1) ** 2)))


def worst_picture(worst: Worst) -> str:
    """Figure (SVG text) of the strip at its worst moment: measured, before and
    after.
    """
    with canvas(8.0, 3.2) as figure:
        axis = figure.add_subplot()
        _midline(axis, worst.run, worst.image)
        axis.axhline(0, color=MUTED, lw=0.8)
        _legend_above(figure, axis)
        return as_svg(figure)


def _midline(axis: Axes, run: RunScenes, k: int) -> None:
    """Draw measured and simulated midlines of image number `k`."""
    points = (
        1e3 * run.measured.curve.points[k] if run.measured.curve else np.zeros((1, 2))
    )
    axis.plot(*points.T, "o", ms=3.5, color=INK, alpha=0.35, mew=0, label="measured")
    looks = {
        "before": (COLOUR_BEFORE, "simulated from the refitted file"),
        "after": (COLOUR_AFTER, "simulated with what was found"),
    }
    for word, (colour, label) in looks.items():
        scene = run.scenes.get(word)
        if scene and scene.curve:
            line = 1e3 * scene.curve.points[k]
            axis.plot(*line.T, color=colour, lw=1.6, label=label)
    low, high = points.min(axis=0), points.max(axis=0)
    x, z = 0.5 * (low + high)
    half = 0.55 * (high - low).max() + 5.0
    axis.set(
        xlim=(x - 1.5 * half, x + 1.5 * half),
        ylim=(z - half, z + half),
        aspect="equal",
        xlabel="x [mm]",
        ylabel="z [mm]",
    )


def _legend_above(figure: Figure, axis: Axes) -> None:
    """Put the legend of `axis` above all axes of `figure`."""
    figure.legend(*axis.get_legend_handles_labels(), ncols=3, loc="outside upper left")


def run_bars(names: Sequence[str], by_fit: Mapping[str, Array]) -> str:
    """Figure (SVG text) of the excess residual (R,) [sigma] of each held-out run, by
    fit.
    """
    with canvas(6.0, 1.2 + 0.4 * len(names)) as figure:
        axis = _bars(figure, names, by_fit, "beyond noise [sigma]")
        axis.set_xlim(0.0, 1.05 * max(1e-9, *map(np.max, by_fit.values())))
        _legend_above(figure, axis)
        return as_svg(figure)


def _bars(
    figure: Figure, names: Sequence[str], by_fit: Mapping[str, Array], label: str
) -> Axes:
    """Axes with a bar (n,) by fit in a row for each of the `names`."""
    axis: Axes = figure.add_subplot()
    rows = np.arange(len(names))
    for k, (word, sizes) in enumerate(by_fit.items()):
        colour = (COLOUR_BEFORE, COLOUR_AFTER)[k]
        axis.barh(rows + 0.4 * k, sizes, 0.38, color=colour, label=word)
    axis.set_yticks(rows + 0.2 * (len(by_fit) - 1), names)
    axis.invert_yaxis()
    axis.set_xlabel(label)
    return axis
