"""HTML page of a benchmark: every figure of the paper, beside the numbers of its text."""

import io
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cell.record.documents import plain
from cell.report.drawing import MUTED, as_svg, canvas
from cell.report.markup import (
    Tone,
    definitions,
    drawing,
    masthead,
    page,
    section,
    table,
    verdict_box,
)
from cell.report.verdict import Verdict
from cell.report.words import NO_VALUE, millimetres
from cell.studies.benchmark import paper
from cell.studies.benchmark.claims import THREE, claims
from cell.studies.benchmark.figures.critical import critical_figure
from cell.studies.benchmark.figures.displacement import (
    main_picture,
    outside,
    range_figure,
    repeats_figure,
    strips_figure,
)
from cell.studies.benchmark.figures.grids import force_figure, maps_figure
from cell.studies.benchmark.figures.motion import (
    adaptation_figure,
    level_figure,
    measures_figure,
    policy_figure,
)
from cell.studies.benchmark.figures.photograph import photograph
from cell.studies.benchmark.figures.style import WIDTH, smooth, stiffness_colours
from cell.studies.benchmark.numbers import newtons, numeral
from cell.studies.benchmark.results import Laid, Refused, Results
from cell.studies.benchmark.summary import Row, misses_text, rows
from drivers.files import write_file

DPI = 160


FOLD_WIDTH = 130.0  # mm of the fold


def folded_figure(results: Results) -> str:
    """Shapes of folds, aligned at their ends, and their heights over bending length; SVG."""
    laid = [r for r in results.results if isinstance(r, Laid)]
    if not laid:
        return ""
    with canvas(WIDTH, 2.3) as figure:
        left, right = figure.subplots(1, 2, width_ratios=[1.7, 1])
        shades = stiffness_colours(len(laid))
        for fold, shade in zip(laid, shades, strict=True):
            shape = 1e3 * smooth(np.array(fold.shape))
            shape[:, 0] -= shape[:, 0].max()
            near = shape[:, 0] > -FOLD_WIDTH
            left.plot(*shape[near].T, color=shade, lw=1.8)
            right.plot(1e3 * fold.bending_length, shape[:, 1].max(), "o", color=shade, ms=5)
            h = shape[:, 1].max()
            right.annotate(f"{h:.1f}", (1e3 * fold.bending_length, h), (6, -6),
                           textcoords="offset points", color=shade, fontsize=8)  # fmt: skip
        c = np.array([0.0, 1.08e3 * max(fold.bending_length for fold in laid)])
        right.plot(c, paper.FOLDED_HEIGHT * c, color=MUTED, lw=1)
        right.annotate("0.9066 c", (c[1], paper.FOLDED_HEIGHT * c[1]), (-8, -2),
                       textcoords="offset points", ha="right", color=MUTED, fontsize=8)  # fmt: skip
        left.set(xlabel="x from the fold's end  [mm]", ylabel="z  [mm]", aspect="equal")
        left.set_ylim(-1.5, None)
        right.set(xlabel="bending length c  [mm]", ylabel="height h  [mm]")
        return as_svg(figure)


def write_results(results: Results, folder: Path) -> Path:
    """Write benchmark.json and benchmark.html into `folder`; the path of the page."""
    content = results.model_dump_json(by_alias=True, indent=1)
    write_file(folder / "benchmark.json", content)
    page = folder / "benchmark.html"
    write_file(page, page_of(results))
    return page


def write_main_picture(results: Results, path: Path) -> None:
    """The displacements on all strips as a PNG at `path`."""
    from matplotlib import rc_context

    content = io.BytesIO()
    with rc_context({"svg.fonttype": "path"}):
        main_picture(results).savefig(content, format="png", dpi=DPI, facecolor="white")
    write_file(path, content.getvalue())


def lines(results: Results) -> list[dict[str, Any]]:
    """Objects for a program: one for each policy, then one for each claim; None if unknown."""
    summary = [{"kind": "policy", **asdict(row)} for row in rows(results)]
    claimed = [{"kind": "claim", **asdict(claim)} for claim in claims(results)]
    return [plain(line) for line in (*summary, *claimed)]


TITLE = "Feedback-based fabric strip folding, from simulation"
NOT_IN_SOURCE = (
    "The paper's measured points stand only in pictures that are not part of its source; what is "
    "drawn of the paper are the numbers that its text states."
)


def page_of(results: Results) -> str:
    """The page of `results`, self-contained."""
    return page(TITLE, list(_parts(results)))


def verdict_of(results: Results) -> Verdict:
    """Whether the paper's main claim holds: feedback under 20 mm on every strip, from images."""
    limit = f"{1e3 * paper.WORST['feedback']:.0f} mm"
    row = next((row for row in rows(results) if row.policy == "feedback"), None)
    if row is None or row.strips.folded == 0:
        return Verdict("fair", "Feedback was not folded", ("Its claim was not tried.",))
    main = claims(results)[0]
    strips = row.strips
    headline = f"Under {limit} on every strip: {'held' if main.held else 'not held'}"
    sentences = (
        f"Feedback folded {strips.folded} of {strips.of} strips through rendered images: "
        f"{main.here}, in the mean {millimetres(strips.mean, signed=True)}.",
        f"The camera was at most {millimetres(strips.misread)} off the twin's truth.",
        NOT_IN_SOURCE,
    )
    tone: Tone = "good" if main.held else "bad"
    return Verdict(tone, headline, sentences, millimetres(strips.worst), "worst |d|, feedback")


def _parts(results: Results) -> Iterator[str]:
    yield masthead("Benchmark", results.made_with.get("cell", ""))
    said = verdict_of(results)
    yield verdict_box(said.tone, said.headline, said.sentences, said.figure, said.error)
    claimed = [("held" if c.held else "not held", c.says, c.here) for c in claims(results)]
    yield section(
        "What the paper says, and what came out here",
        table(("", "the paper's text", "here, through images"), claimed),
    )
    yield from _displacements(results)
    yield from _range(results)
    yield from _hidden_effects(results)
    yield from _model(results)
    yield from _motions(results)
    refused = [(r.part, r.reason) for r in results.results if isinstance(r, Refused)]
    yield section("What could not be measured", table(("part", "why"), refused))
    yield section("Made with", definitions(_made_with(results), "rows"))


def _displacements(results: Results) -> Iterator[str]:
    summary = rows(results)
    yield section(
        "Displacement of the strips",
        drawing(strips_figure(results), "displacement of each strip by each policy"),
        table(
            (
                *("policy", "folded", "mean", "from", "to", "worst |d|", "on", "seen − true"),
                *("repeats", "edges apart", "worst"),
            ),
            [_strip_row(row) for row in summary],
        ),
        note="One fold of each strip by each policy, closed loop through images, d as the camera "
        "saw it, in mm; the softest strip on top. Negative: the layers touch too soon, as on the "
        "triangle. Edges apart: once laid and released, by truth. Dashed and shaded: the paper's "
        "numbers for its own ten fabrics.",
    )
    yield section(
        "Repeatability",
        drawing(repeats_figure(results), "folds of one strip with new noise"),
        note=f"Folds of {results.asked.repeated} by each policy, each with new noise in the image: "
        f"{results.asked.repeats}. The paper's fabrics also change from fold to fold; the "
        "twin's do not.",
    )


def _range(results: Results) -> Iterator[str]:
    summary, extent = rows(results), results.asked.extent
    strays = [(p, *outside(results, p)) for p in THREE if p in results.asked.policies]
    counted = "; ".join(f"{p} {out} of {of}" for p, out, of in strays if of)
    yield section(
        "Simulated displacement over the paper's range",
        drawing(range_figure(results), "simulated displacement of each policy"),
        note="Shaded: all strips of the range in the rod, darker the middle 90 %, the line the "
        "median. Squares: the strips folded through images. Strips outside of the range "
        f"simulated: {counted or NO_VALUE}. The paper had one of ten outside.",
    )
    yield section(
        "The range as maps",
        drawing(maps_figure(results), "displacement over stiffness and damping"),
        table(
            ("policy", "mean |d|", "95 %", "worst", "no touch", "on the chain", "worst", "N"),
            [_range_row(row) for row in summary],
        ),
        note=f"d in mm over {extent.grid} x {extent.grid} strips of the paper's (k, b) in the "
        "rod, a logarithmic grid with corners; given the state, feedback with its noise and "
        f"delay. On the chain, the other engine: {extent.chain} x {extent.chain} strips.",
    )
    yield section(
        "Force that holds the fixed edge",
        drawing(force_figure(results), "holding force of each policy"),
        note="Mean over a fold from the take-over on, and the middle 90 % of the range. The "
        "paper's strip weighs 9.7 N; the force decides whether a loose edge slips.",
    )


def _hidden_effects(results: Results) -> Iterator[str]:
    policies = [policy for policy in results.asked.policies if results.hidden_folds(policy)]
    if not policies:
        return
    found = {
        (r.policy, r.effect): misses_text(r) for p in policies for r in results.hidden_folds(p)
    }
    effects = dict.fromkeys(effect for _, effect in found)
    misses = [
        (effect.replace("_", " ") or "none", *(found.get((p, effect), NO_VALUE) for p in policies))
        for effect in effects
    ]
    yield section(
        "Effects that the policy does not know",
        table(("hidden", *policies), misses),
        note="|d| in mm, mean / 95 % / worst, of strips drawn at random over the paper's range, "
        "each with the effect at a size that textiles have, in the rod, observed with the noise "
        f"and delay of images: {results.asked.extent.hidden} strips each. `planned` knows the "
        "strip, not its effect.",
    )


def _model(results: Results) -> Iterator[str]:
    yield section(
        "The folded strip",
        drawing(folded_figure(results), "folded strips at rest and their height"),
        note="Folded and let go on the chain, from soft to stiff. The height h that the paper "
        "uses for stiffness is 0.9066 bending lengths for the heavy elastica.",
    )
    yield section(
        "Critical points",
        drawing(critical_figure(results), "gripper position at the first touch"),
        note="Where the gripper stands when the layers first touch while it moves level at "
        "height z [mm]. Areas: all dampings of the paper's range, the line its least one. The "
        "paper's measured points are not in its source.",
    )
    yield section(
        "Strip states in a level motion",
        drawing(level_figure(results), "strip states in a level motion"),
        note="Bold: the first state in which the layers touch; the fold snaps just before.",
    )


def _motions(results: Results) -> Iterator[str]:
    seen = photograph(results)
    picture = f'<figure><img src="data:image/jpeg;base64,{seen}" alt="" width="100%"></figure>'
    yield section(
        "What the controller sees",
        picture if seen else "",
        note="A rendered image of a fold by feedback. Red: the line searched for the desk "
        "contact (green). Blue: the gripper. Black: triangle and circle.",
    )
    yield section(
        "State, action and displacement",
        drawing(measures_figure(results), "state and action, and the lengths at the touch"),
        note="Feedback decides the direction φ from gripper x, z and desk contact x. At the "
        "first touch l₁ and l₂ give the displacement.",
    )
    yield section(
        "Feedback on one strip",
        drawing(policy_figure(results), "strip states under the learned policy"),
        note="Green: the gripper's path under the learned policy. Dashed: triangle and circle.",
    )
    yield section(
        "Adaptation to stiffness",
        drawing(adaptation_figure(results), "paths for different stiffness"),
        note="The learned policy's paths, blue for the softest strip, green for the stiffest.",
    )


def _strip_row(row: Row) -> tuple[str, ...]:
    s = row.strips
    numbers = [numeral(value, signed=True) for value in (s.mean, s.low, s.high)]
    tail = [numeral(s.worst), s.worst_strip, numeral(s.misread), numeral(row.spread)]
    tail += [numeral(s.offset), numeral(s.worst_offset)]
    return row.policy, f"{s.folded} of {s.of}", *numbers, *tail


def _range_row(row: Row) -> tuple[str, ...]:
    rod, chain = row.rod, row.chain
    numbers = [numeral(value) for value in (rod.mean, rod.quantile_95, rod.worst)]
    other = [numeral(chain.mean), numeral(chain.worst), newtons(rod.force)]
    return row.policy, *numbers, str(rod.untouched), *other


def _made_with(results: Results) -> list[tuple[str, str]]:
    asked = results.asked
    rows = [("speed", f"{results.speed:g} m/s"), ("seed", str(asked.seed))]
    return [*rows, ("strips", ", ".join(asked.strips)), *results.made_with.items()]
