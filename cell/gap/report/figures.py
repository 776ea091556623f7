"""Figures of a fit's report, as SVG text, and the runs simulated again for them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

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
from cell.gap.verdict.compose import SIGNIFICANT
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from cell.report.drawing import BLUE, INK, MUTED, ORANGE, RULE, as_svg, canvas
from cell.report.words import plain
from drivers.base.types import Array

COLOURS = COLOUR_BEFORE, COLOUR_AFTER = ORANGE, BLUE
SIMULATED = {
    "before": "simulated from the refitted file",
    "after": "with what was found",
}
COLUMN = 0.34  # inch, width of a column of the heat map
HEAT_TICKS = (0, 1, 3, 10, 30, 100, 1000, 10000)  # sigma, on its logarithmic scale


class RunScenes(NamedTuple):
    """Drawings of one run as it was measured and as it is simulated, under the keys
    `measured`, `before` and `after`: without and with the effects that were accepted.

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
    """Verdict of a fit that also has a figure of how residuals shrink."""

    def plot(self) -> Figure:
        """Figure with the residuals of held-out runs for each measured quantity, before
        and after effects were added, in units of their noise.
        """
        gap = self.gap
        noise = {key: value for key, value in gap.floor.items() if value}
        sides = {"before": gap.before, "after": gap.after}
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
    """Figure, as SVG text, of folded strips when their layers touch, from midlines
    given by name, each of shape (n, 2) with x and z [m] in a row.
    """
    with canvas(7.0, 2.2) as figure:
        axes = figure.add_subplot(aspect="equal", anchor="W")
        axes.axhline(0, color=MUTED, lw=0.8)
        axes.set_prop_cycle(color=COLOURS)
        for name, points in shapes.items():
            axes.plot(*(1e3 * points).T, label=name)
        axes.set(xlabel="x  [mm]", ylabel="z  [mm]")
        _legend_above(figure, axes)
        return as_svg(figure)


def replay(findings: Findings) -> Iterator[RunScenes]:
    """Simulate runs for drawings, without and with the accepted effects, and yield the
    drawings of each run, held-out runs first.
    """
    subject = findings.subject
    fitted: dict[str, FitEstimate] = {"before": findings.base}
    if findings.accepted.effects:
        fitted["after"] = findings.accepted
    yield from replay_runs(subject, findings.held_out_fits.by_key, held_out=True)
    yield from replay_runs(subject, fitted, held_out=False)


def replay_runs(
    subject: Subject, fits: Mapping[str, FitEstimate], *, held_out: bool
) -> Iterator[RunScenes]:
    """Simulate the runs of `fits`, which holds one fit under the key `before` and,
    where something was accepted, one under `after`; yields the drawings of each run.
    """
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
    """Figure, as SVG text, of how far residuals lie from zero, in standard deviations:
    a column for each kind of motion, a row for each measured quantity, part of the
    subject and phase.
    """
    cells = {((p.channel, p.zone, p.phase), p.condition): p for p in places}
    rows, columns = (sorted({*words}) for words in zip(*cells, strict=True))
    high = len(rows)
    wide = len(columns)

    # what is NaN stays blank
    strengths, probabilities = np.full((2, high, wide), np.nan)
    for (row, column), place in cells.items():
        at = rows.index(row), columns.index(column)
        strengths[at] = abs(place.z)
        probabilities[at] = place.p

    highest = max(9.0, np.nanmax(strengths))
    scale = FuncNorm((np.log1p, np.expm1), 0.0, highest)
    with canvas(max(5.0, 1.8 + COLUMN * wide), max(2.0, 0.9 + 0.3 * high)) as figure:
        axis = figure.add_subplot()
        axis.grid(visible=False)
        image = axis.imshow(strengths, cmap="YlOrRd", aspect="auto", norm=scale)
        axis.set_yticks(range(high), [" · ".join(row) for row in rows])
        axis.set_xticks(
            range(wide),
            [*map(motion_name, columns)],
            rotation=40,
            ha="right",
            rotation_mode="anchor",
        )
        for i, k in np.argwhere(probabilities < SIGNIFICANT).tolist():
            axis.plot(k, i, "o", ms=2.5, color=INK)

        ticks = [z for z in HEAT_TICKS if z <= highest]
        figure.colorbar(
            image, ax=axis, pad=0.01, ticks=ticks, label="sigma beyond noise"
        )
        axis.set_xlabel("condition")
        return as_svg(figure)


def residual_traces(
    fits: Mapping[str, FitEstimate], run: int, quantities: Mapping[str, Quantity]
) -> str:
    """Figure, as SVG text, of residuals over time in the run with the index `run`, for
    each of `fits`, which are given by key.
    """
    samples = fits["before"].runs[run].samples
    order = np.argsort(samples.t, kind="stable")
    owner = samples.series[order]
    every = [order[owner == number] for number in np.unique(owner)]
    by_series = [rows for rows in every if len(rows) > 1]
    if not by_series:
        return ""

    means = {word: fit.raw[run].mean for word, fit in fits.items()}
    times = samples.t[np.concatenate(by_series)]
    count = len(by_series)
    with canvas(7.5, 0.8 + 1.35 * count) as figure:
        axes = figure.subplots(count, sharex=True, squeeze=False).ravel()
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
    """Draw the residuals of one time series of samples into `axis`, those of each fit
    in `means`, over a band of two standard deviations of noise.
    """
    first = rows[0]
    t = samples.t[rows]
    quantity = quantities[str(samples.quantity[first])]
    factor = quantity.factor
    band = 2.0 * factor * samples.reading[rows]
    axis.fill_between(t, -band, band, color=RULE, lw=0, gid="2 sigma of the noise")
    zone, *others = {*samples.zone[rows]}
    name = f"{samples.channel[first]}{'' if others else f' {zone}'}"

    for (word, mean), colour in zip(means.items(), COLOURS, strict=False):
        shown = factor * mean[rows]
        axis.plot(t, shown, color=colour, lw=1.2, label=word, gid=f"{name}, {word}")

    axis.set_ylabel(f"{name}\n[{quantity.unit}]")
    axis.axhline(0.0, color=INK, lw=0.5)


class Worst(NamedTuple):
    """Moment of a run at which the simulation without effects is farthest from the
    measured curve, with the image of that moment and its distances.

    `t` [s] is that of image number `image`, `off` the rms distances [m] of the measured
    points from the simulated curves by their key.
    """

    run: RunScenes
    image: int
    t: float
    off: Mapping[str, float]


def worst_moment(runs: Sequence[RunScenes]) -> Worst | None:
    """Moment at which the simulation without effects is farthest from the measured
    curve, out of all moments of `runs`; None where these have no curve.
    """
    found = None
    for run in runs:
        curves = {key: drawn.curve for key, drawn in run.scenes.items() if drawn.curve}
        curve = curves.pop("measured", None)
        before = curves.get("before")
        if not (curve and len(curve.t) and before):
            continue

        measured = curve.points
        distances = [*map(_distance, measured, before.points)]
        image = int(np.argmax(distances))
        if found and found.off["before"] >= distances[image]:
            continue

        off = {
            k: _distance(measured[image], c.points[image]) for k, c in curves.items()
        }
        found = Worst(run=run, image=image, t=curve.t[image], off=off)
    return found


def _distance(points: Array, line: Array) -> float:
    """Root mean square distance [m] of `points` from the nearest nodes of the curve
    `line`, both with a row of two coordinates for each point.
    """
    apart = np.hypot(*(points[:, None] - line[None]).transpose(2, 0, 1))
    return float(np.sqrt(np.mean(apart.min(axis=1) ** 2)))


def worst_picture(worst: Worst) -> str:
    """Figure, as SVG text, of the strip at its worst moment, as it was measured and as
    it is simulated before and after effects were added.
    """
    with canvas(7.0, 4.6) as figure:
        axis = figure.add_subplot()
        _midline(axis, worst.run, worst.image)
        axis.axhline(0, color=MUTED, lw=0.8)
        _legend_above(figure, axis)
        return as_svg(figure)


def _midline(axis: Axes, run: RunScenes, k: int) -> None:
    """Draw into `axis` the measured and the simulated midlines of a run in image number
    `k`.
    """
    curves = {word: scene.curve for word, scene in run.scenes.items() if scene.curve}
    drawn = {word: 1e3 * curve.points[k] for word, curve in curves.items()}
    points = drawn.pop("measured")
    axis.plot(*points.T, "o", ms=3.5, color=INK, alpha=0.35, mew=0, label="measured")
    for (word, line), colour in zip(drawn.items(), COLOURS, strict=False):
        axis.plot(*line.T, color=colour, lw=1.6, label=SIMULATED[word])

    low = points.min(axis=0)
    high = points.max(axis=0)
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
    """Put the legend of `axis` above all axes of the Matplotlib `figure`."""
    figure.legend(*axis.get_legend_handles_labels(), ncols=3, loc="outside upper left")


def run_bars(names: Sequence[str], by_fit: Mapping[str, Array]) -> str:
    """Figure, as SVG text, of how many standard deviations the residuals of each
    held-out run exceed noise, with a bar for each fit; its array has the shape (runs,).
    """
    with canvas(6.0, 1.2 + 0.4 * len(names)) as figure:
        axis = _bars(figure, names, by_fit, "beyond noise [sigma]")
        axis.set_xlim(0.0, 1.05 * max(1e-9, *map(np.max, by_fit.values())))
        _legend_above(figure, axis)
        return as_svg(figure)


def _bars(
    figure: Figure, names: Sequence[str], by_fit: Mapping[str, Array], label: str
) -> Axes:
    """Axes with a line for each of `names`, which holds one horizontal bar for each fit
    in `by_fit`.
    """
    axis: Axes = figure.add_subplot()
    rows = np.arange(len(names))
    for k, (word, sizes) in enumerate(by_fit.items()):
        axis.barh(rows + 0.4 * k, sizes, 0.38, color=COLOURS[k], label=word)
    axis.set_yticks(rows + 0.2 * (len(by_fit) - 1), names)
    axis.invert_yaxis()
    axis.set_xlabel(label)
    return axis
