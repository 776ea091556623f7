"""HTML page of a benchmark: figures of its results, beside the published numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from cell.record.documents import plain
from cell.report.drawing import GREEN, INK, MUTED, PAPER, RULE, as_png, as_svg, canvas
from cell.report.html import Card, Tone, page
from cell.report.words import MINUS, NO_VALUE, millimetres
from cell.studies.results import MissingPart, RangeFolds, Results, displacements
from cell.studies.summary import (
    PAPER_MEANS,
    PAPER_POLICIES,
    PAPER_WORST,
    REPEATABILITY,
    claims,
    misses_text,
    numeral,
    rows,
)
from drivers.base.errors import in_mm
from drivers.base.files import write_file
from drivers.base.outputs import write_output
from policies.registry import look_of
from policies.rollout import Misses
from policies.strip_sampling import DAMPING_RATIO, STIFFNESS_RANGE

DPI = 160
TITLE = "Feedback-based fabric strip folding, from simulation"
NOT_IN_SOURCE = "Of the paper, the numbers that its text states are drawn."


def write_results(results: Results, folder: Path) -> Path:
    """Write benchmark.json and benchmark.html into `folder`; returns the page's
    path.
    """
    write_file(
        folder / "benchmark.json", results.model_dump_json(by_alias=True, indent=1)
    )
    page = folder / "benchmark.html"
    write_file(page, page_of(results))
    return page


def write_main_picture(results: Results, path: Path) -> None:
    """Draw the displacements on all strips as a PNG file at `path`."""
    from matplotlib import rc_context

    with rc_context({"svg.fonttype": "path"}):
        write_output(path, as_png(_main_picture(results), DPI))


def lines(results: Results) -> list[dict[str, Any]]:
    """JSON objects of the results: one for each policy, then one a claim; None if
    unknown.
    """
    summary = [{"kind": "policy", **asdict(row)} for row in rows(results)]
    claimed = [{"kind": "claim", **asdict(claim)} for claim in claims(results)]
    return [plain(line) for line in (*summary, *claimed)]


def page_of(results: Results) -> str:
    """Self-contained HTML page of `results`."""
    summary = rows(results)
    strips = []
    for row in summary:
        edges_apart = map(numeral, (row.strips.offset, row.strips.worst_offset))
        strips.append((*row.strip_cells(), *edges_apart))

    asked = results.asked
    made_with = {
        "speed": f"{results.speed:g} m/s",
        "seed": str(asked.seed),
        "strips": ", ".join(asked.strips),
        **results.made_with,
    }
    made_with.pop("weights", None)
    missing = [result for result in results.results if isinstance(result, MissingPart)]
    return page(
        "studies/benchmark.html",
        TITLE,
        version=results.made_with.get("cell", ""),
        said=verdict_of(results),
        claims=[
            ("held" if c.held else "not held", c.says, c.here) for c in claims(results)
        ],
        asked=asked,
        strips=strips,
        ranges=[row.range_cells() for row in summary],
        outside=_outside_range(results),
        hidden=_hidden_effects(results),
        figures={name: draw(results) for name, draw in FIGURES.items()},
        refused=[(part.part, part.reason) for part in missing],
        made_with=made_with.items(),
    )


def verdict_of(results: Results) -> Card:
    """Verdict on the published claim that feedback folds every strip to under
    PAPER_WORST [m].
    """
    limit = in_mm(PAPER_WORST["feedback"])
    row = next((row for row in rows(results) if row.policy == "feedback"), None)
    if row is None or row.strips.folded == 0:
        said = "It is made of the policy `feedback`, which folded no strip here."
        return Card("fair", "The paper's claim was not tried", (said,))

    main = next(claims(results))
    strips = row.strips
    headline = f"Under {limit} on every strip: {'held' if main.held else 'not held'}"
    sentences = (
        (
            f"Feedback folded {strips.folded} of {strips.of} strips through rendered"
            f" images: {main.here}, in the mean"
            f" {millimetres(strips.mean, signed=True)}."
        ),
        f"The camera was at most {millimetres(strips.misread)} off the twin's truth.",
        NOT_IN_SOURCE,
    )
    tone: Tone = "good" if main.held else "bad"
    return Card(
        tone=tone,
        headline=headline,
        sentences=sentences,
        figure=millimetres(strips.worst),
        error="worst |d|, feedback",
    )


def _outside_range(results: Results) -> str:
    """Text that counts, for each published policy, the strips whose d left its
    simulated range.
    """
    texts = []
    for policy in PAPER_POLICIES:
        seen = displacements(results.folds(policy))
        seen = seen[np.isfinite(seen)]
        simulated = results.over_range(policy, "rod")
        if (
            simulated is None
            or seen.size == 0
            or np.isnan(simulated.displacement_grid).all()
        ):
            continue

        below = seen < np.nanmin(simulated.displacement_grid)
        above = seen > np.nanmax(simulated.displacement_grid)
        texts.append(f"{policy} {np.sum(below | above)} of {seen.size}")
    return "; ".join(texts) or NO_VALUE


def _hidden_effects(results: Results) -> dict[str, Any]:
    """Table of misses with effects unknown to the policies: rows by effect, columns by
    policy.
    """
    misses: dict[str, dict[str, str]] = {}
    for policy in results.asked.policies:
        for folds in results.hidden_folds(policy):
            misses.setdefault(folds.effect, {})[policy] = misses_text(folds)
    policies = list(dict.fromkeys(chain(*misses.values())))
    rows = [
        (
            effect.replace("_", " ") or "none",
            *(texts.get(policy, NO_VALUE) for policy in policies),
        )
        for effect, texts in misses.items()
    ]
    return {"head": ("hidden", *policies), "rows": rows}


PAGE_WIDTH = 8.4  # inch, of a page
NOTE = 8.0  # points
BAND = "#7fa98f"
DASHES = (0, (4, 3))
DISPLACEMENT = "d = l₁ − l₂  [mm]"
FEEDBACK_LIMIT = 1e3 * PAPER_WORST["feedback"]  # mm
COLOUR_RANGE = 90.0  # mm, where the colours end
LINEAR = 8.0  # mm, up to about which the colour scale is linear
BAR_TICKS = (-80, -20, -5, 5, 20, 80)  # mm
FEWEST_COLUMNS = 3
LEGEND_ABOVE: Mapping[str, Any] = {  # the axes, of three columns
    "loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0.2, "ncols": 3,
    "handletextpad": 0.2, "columnspacing": 1.4, "markerscale": 0.9,
}  # fmt: skip


def colour(policy: str) -> str:
    """Colour of `policy` in figures, as #rrggbb."""
    return look_of(policy).colour


def dot(policy: str) -> dict[str, Any]:
    """Arguments of matplotlib's `plot` for the marker of `policy`."""
    look = look_of(policy)
    face = {"mfc": look.colour, "mec": look.colour}
    return {"marker": look.marker, "ms": look.size, "ls": "", **face}


def _label_rows(axes: Any, names: Sequence[str], foot: float = 0.0) -> None:
    """Label the y axis with a row for each of `names`, the first on top, `foot` free
    rows below.
    """
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5 + foot, -0.5)
    axes.tick_params(axis="y", labelcolor=INK, labelsize=9)
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)


def _policy_rows(axes: Any, policies: Sequence[str], foot: float = 0.0) -> None:
    """Label the y axis with a row for each policy, in its colour, with `foot` free rows
    below.
    """
    _label_rows(axes, policies, foot)
    for label, policy in zip(axes.get_yticklabels(), policies, strict=True):
        label.set(color=colour(policy), fontweight="bold")


def _draw_zero_line(axes: Any) -> None:
    """Draw the line of d = 0, where the layers are aligned."""
    axes.axvline(0.0, color=INK, lw=0.8, zorder=1)


def _strips_figure(results: Results) -> str:
    """Figure (SVG) of displacements d by policy and strip, beside the published
    numbers.
    """
    with canvas(PAGE_WIDTH, _height(results)) as figure:
        _draw_strips(figure.add_subplot(), results)
        return as_svg(figure)


def _main_picture(results: Results) -> Any:
    """Matplotlib figure of the displacements d on every strip, with its own title."""
    with canvas(PAGE_WIDTH, _height(results) + 0.2) as figure:
        axes = figure.add_subplot()
        _draw_strips(axes, results)
        title = "Misalignment of the layers, as the camera saw it on the twin"
        axes.set_title(title, loc="left", pad=42, fontsize=10.5, color=INK)
        return figure


def _repeats_figure(results: Results) -> str:
    """Figure (SVG) of d in repeated folds of a strip about its mean, with the published
    1 mm.
    """
    policies = results.asked.policies
    half = 0.5e3 * REPEATABILITY
    with canvas(PAGE_WIDTH, 0.34 * len(policies) + 0.75) as figure:
        axes = figure.add_subplot()
        axes.axvspan(-half, half, color=BAND, alpha=0.18, lw=0)
        _draw_zero_line(axes)
        widest = 2 * half

        for row, policy in enumerate(policies):
            d = 1e3 * displacements(results.repeats(policy))
            d = d[np.isfinite(d)]
            away = d - d.mean() if d.size else d
            widest = max(widest, np.max(np.abs(away), initial=0.0))
            axes.plot(
                away,
                np.full(d.size, row),
                **dot(policy),
                alpha=0.75,
                clip_on=False,
                gid=policy,
            )

        _policy_rows(axes, policies)
        axes.set_xlim(-1.08 * widest, 1.08 * widest)
        axes.set_xlabel(
            f"d of {results.asked.repeated}, about the mean of its folds  [mm]"
        )
        top = axes.get_xaxis_transform()
        text = f"paper: within {in_mm(REPEATABILITY)}"
        axes.text(0, 1.02, text, transform=top, ha="center", color=GREEN, fontsize=NOTE)
        return as_svg(figure)


def _range_figure(results: Results) -> str:
    """Figure (SVG) of d by policy, over a simulated range of strips and in folds
    through images.
    """
    policies = results.asked.policies
    with canvas(PAGE_WIDTH, 0.42 * len(policies) + 1.1) as figure:
        axes = figure.add_subplot()
        _draw_paper_numbers(axes)
        _draw_zero_line(axes)
        for row, policy in enumerate(policies):
            _draw_policy_range(axes, results, policy, row)

        axes.use_sticky_edges = False
        axes.margins(x=0.03)
        _policy_rows(axes, policies, foot=0.5)
        axes.set_xlabel(DISPLACEMENT)
        return as_svg(figure)


def _draw_strips(axes: Any, results: Results) -> None:
    """Draw the displacements of each policy in a row for each strip, soft ones on
    top.
    """
    strips = _soft_to_stiff(results)
    _draw_paper_numbers(axes)
    _draw_zero_line(axes)
    for row in range(len(strips)):
        axes.axhline(row, color=RULE, lw=0.6, zorder=0)

    for policy in results.asked.policies:
        folds = results.folds(policy)
        rows = [strips.index(fold.strip) for fold in folds]
        front = 6 - 0.2 * look_of(policy).size  # smaller markers lie over larger ones
        d = 1e3 * displacements(folds)
        axes.plot(d, rows, **dot(policy), label=policy, zorder=front, clip_on=False)

    _label_rows(axes, strips, foot=0.55)  # room for the paper's numbers
    axes.set_xlabel(DISPLACEMENT)
    axes.legend(**LEGEND_ABOVE, labelcolor="linecolor")


def _draw_paper_numbers(axes: Any) -> None:
    """Draw the published limit and mean displacements at the foot of the plot."""
    foot = axes.get_xaxis_transform()
    axes.axvspan(
        -FEEDBACK_LIMIT, FEEDBACK_LIMIT, color=BAND, alpha=0.16, lw=0, zorder=0
    )
    style = {"transform": foot, "ha": "center", "va": "bottom", "fontsize": NOTE}
    box = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.2, "alpha": 0.85}
    axes.text(0, 0.012, f"paper < {FEEDBACK_LIMIT:.0f}", color=GREEN, zorder=3, **style)

    for policy, mean in PAPER_MEANS.items():
        x = 1e3 * mean
        axes.axvline(x, color=colour(policy), lw=0.9, ls=DASHES, alpha=0.8, zorder=1)
        text = f"paper {x:+.1f}".replace("-", MINUS)
        axes.text(x, 0.012, text, color=colour(policy), bbox=box, zorder=3, **style)


def _draw_policy_range(axes: Any, results: Results, policy: str, row: int) -> None:
    """Draw a policy's simulated range of d as bars, and its folds through images as
    squares.
    """
    over = results.over_range(policy, "rod")
    if over is not None and np.isfinite(over.displacement_grid).any():
        d = 1e3 * over.displacement_grid[np.isfinite(over.displacement_grid)]
        low, high = np.quantile(d, [0.05, 0.95])
        shade = {"color": colour(policy), "lw": 0}
        axes.barh(row, np.ptp(d), left=d.min(), height=0.56, alpha=0.20, **shade)
        axes.barh(row, high - low, left=low, height=0.56, alpha=0.22, **shade)
        axes.plot(
            [np.median(d)] * 2, [row - 0.28, row + 0.28], color=colour(policy), lw=1.6
        )

    seen = 1e3 * displacements(results.folds(policy))
    mark = {"ms": 4.4, "mfc": PAPER, "mec": INK, "mew": 0.9, "zorder": 4}
    axes.plot(seen, np.full(seen.size, row), "s", gid="through images", **mark)


def _soft_to_stiff(results: Results) -> list[str]:
    """Names of the folded strips by rising bending length."""
    lengths = {
        fold.strip: fold.bending_length
        for policy in results.asked.policies
        for fold in results.folds(policy)
    }
    return sorted(lengths, key=lambda strip: (lengths[strip], strip))


def _height(results: Results) -> float:
    return 0.31 * max(len(_soft_to_stiff(results)), 3) + 1.15


def _maps_figure(results: Results) -> str:
    """Figure (SVG) with a map of d over stiffness and damping per policy; empty without
    data.
    """
    found = [results.over_range(policy, "rod") for policy in results.asked.policies]
    measured = [folds for folds in found if folds is not None]
    if not measured:
        return ""
    with canvas(PAGE_WIDTH, 2.5) as figure:
        columns = max(len(measured), FEWEST_COLUMNS)
        panels = figure.subplots(1, columns, sharey=True, squeeze=False)[0]
        maps = [
            _draw_map(axes, folds)
            for axes, folds in zip(panels, measured, strict=False)
        ]
        for axes in panels[len(measured) :]:
            axes.set_axis_off()

        panels[0].set_ylabel("damping over the least")
        bar = figure.colorbar(
            maps[-1], ax=list(panels), shrink=0.8, pad=0.01, aspect=22
        )
        bar.outline.set_visible(False)
        bar.minorticks_off()
        bar.set_ticks(
            BAR_TICKS, labels=[f"{tick:+d}".replace("-", MINUS) for tick in BAR_TICKS]
        )
        bar.set_label("d  [mm]")
        return as_svg(figure)


def _force_figure(results: Results) -> str:
    """Figure (SVG) of the mean force [N] on the fixed edge by policy, with its 5 to 95
    % range.
    """
    policies = results.asked.policies
    with canvas(PAGE_WIDTH, 0.34 * len(policies) + 0.7) as figure:
        axes = figure.add_subplot()
        for row, policy in enumerate(policies):
            folds = results.over_range(policy, "rod")
            if folds is None:
                continue

            low, high = np.quantile(folds.force, [0.05, 0.95])
            axes.plot([low, high], [row, row], color=colour(policy), lw=5, alpha=0.25)
            mean = np.mean(folds.force)
            axes.plot(mean, row, **dot(policy), gid=policy)
            axes.annotate(
                f"{mean:.2f} N",
                (high, row),
                (7, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.5,
                color=INK,
            )

        _policy_rows(axes, policies)
        axes.set_xlim(0, None)
        axes.margins(x=0.12)
        axes.set_xlabel("mean force from the take-over to the touch  [N]")
        return as_svg(figure)


def _draw_map(axes: Any, folds: RangeFolds) -> Any:
    """Draw displacements d [mm] over the strips' stiffness and damping; returns the
    colour mesh.
    """
    from matplotlib.colors import AsinhNorm

    norm = AsinhNorm(LINEAR, vmin=-COLOUR_RANGE, vmax=COLOUR_RANGE)
    stiffness = _cell_borders(*STIFFNESS_RANGE, folds.side)
    damping = _cell_borders(1.0, DAMPING_RATIO, folds.side)  # over the least
    d = 1e3 * folds.displacement_grid
    colours = axes.pcolormesh(stiffness, damping, d.T, cmap="RdBu_r", norm=norm, lw=0)

    axes.set(xscale="log", xlim=stiffness[[0, -1]], yscale="log", ylim=damping[[0, -1]])
    axes.set_xticks([0.02, 0.06, 0.2], ["0.02", "0.06", "0.2"])
    axes.set_yticks([1, 7, 50], ["1", "7", "50"])
    axes.minorticks_off()
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)

    name = folds.policy
    axes.set_title(name, fontsize=9.5, color=colour(name), loc="left", pad=25)
    misses = Misses.from_displacements(folds.displacement_grid)
    caption = f"mean {numeral(misses.mean)}\nworst {numeral(misses.worst)}"
    axes.text(0, 1.03, caption, transform=axes.transAxes, fontsize=8.2, color=MUTED)
    axes.set_xlabel("stiffness  [N m/rad]", fontsize=8)
    return colours


def _cell_borders(low: float, high: float, side: int) -> Any:
    """Borders (side + 1,) of `side` logarithmic cells, centred from `low` to `high`."""
    step = (high / low) ** (1 / (side - 1))
    return low * step ** (np.arange(side + 1) - 0.5)


FIGURES = {
    "strips": _strips_figure,
    "repeats": _repeats_figure,
    "range": _range_figure,
    "maps": _maps_figure,
    "force": _force_figure,
}
