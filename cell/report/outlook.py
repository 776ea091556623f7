"""Rows and figure of a policy's predictions, final and over time, for the page of a fold."""

from typing import Any

import numpy as np

from cell.record.header import AgreementNote, Interval, Result
from cell.record.outlook import Outlook
from cell.record.run import Run
from cell.report.drawing import BLUE, INK, MUTED, ORANGE, as_svg, canvas
from cell.report.words import MINUS, millimetres

PANELS = {
    "displacement": ("predicted d  [mm]", 1e3, ORANGE),
    "bending_length": ("bending length  [mm]", 1e3, BLUE),
    "retardation_time": ("retardation time  [ms]", 1e3, BLUE),
    "yield_curvature": ("yarn friction  [1/m]", 1.0, BLUE),
}
HALF_HEIGHT, MARGIN = 40.0, 1.0  # mm, displacements shown to either side of 0, and beyond them


def predictions(result: Result | None) -> list[tuple[str, str]]:
    """Rows of the last prediction before the touch, and of the strip's agreement with its model."""
    if result is None or result.foretold is None:
        return []
    final = result.foretold
    rows = [
        (
            "displacement",
            f"{millimetres(final.displacement, signed=True)} ± {millimetres(final.sigma)}",
        ),
        ("bending length", _interval_text(final.bending_length, 1e3, 1, "mm")),
        ("retardation time", _interval_text(final.retardation_time, 1e3, 0, "ms")),
        ("yarn friction", _interval_text(final.yield_curvature, 1.0, 0, "1/m")),
    ]
    if result.agreement is not None:
        rows.append(("strip and model", _agreement_text(result.agreement)))
    return rows


def outlook_figure(run: Run, outlook: Outlook) -> str:
    """Figure (SVG) of predicted displacement and strip parameters over time, with one sigma."""
    with canvas(8.4, 4.2, layout=None) as figure:
        frame = {"left": 0.075, "right": 0.995, "top": 0.985, "bottom": 0.105}
        grid = figure.subplots(
            2, 2, sharex=True, gridspec_kw=frame | {"wspace": 0.19, "hspace": 0.07}
        )
        for axes, (name, (label, scale, colour)) in zip(grid.flat, PANELS.items(), strict=True):
            _draw_prediction(axes, outlook, name, scale, colour)
            axes.set_ylabel(label)
        measured = None if run.result is None else run.result.displacement
        if measured is not None:
            grid[0, 0].axhline(1e3 * measured, color=INK, lw=1, ls=(0, (1, 2)))
        for axes in grid[1]:
            axes.set_xlabel("t  [s]")
        return as_svg(figure)


def _draw_prediction(axes: Any, outlook: Outlook, name: str, scale: float, colour: str) -> None:
    """Draw one predicted quantity over time, with its band of one sigma."""
    value, low, high = (scale * outlook.column(name + end) for end in ("", "_low", "_high"))
    axes.fill_between(outlook.t, low, high, color=colour, alpha=0.22, lw=0, gid="one sigma")
    axes.plot(outlook.t, value, color=colour, lw=1.2, gid=PANELS[name][0].partition("  [")[0])
    if name == "displacement":
        axes.axhline(0, color=MUTED, lw=0.6)
        ends = np.abs(np.concatenate([low, high]))
        largest = float(np.nanmax(ends, initial=0.0)) if np.isfinite(ends).any() else 0.0
        limit = min(HALF_HEIGHT, largest) + MARGIN
        axes.set_ylim(-limit, limit)


def _interval_text(estimate: Interval, scale: float, digits: int, unit: str) -> str:
    value, low, high = (
        f"{scale * v:.{digits}f}".replace("-", MINUS)
        for v in (estimate.value, estimate.low, estimate.high)
    )
    return f"{value} {unit} ({low} to {high})"


def _agreement_text(note: AgreementNote) -> str:
    verdict = "agree" if note.like_model else "do not agree"
    return f"{verdict}, {millimetres(note.residual)} apart"
