"""`report.html`: one page for a technician, whole in itself."""

from html import escape
from pathlib import Path

from cell.gap.report.evidence import base, candidates, name_model, where
from cell.gap.report.held_out import compare_held_out, conditions, remains
from cell.gap.report.repeats import repeats
from cell.gap.report.sentence import capital, deviation, headline, sentence
from cell.gap.subject.subject import EditsModel
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Kind, Verdict
from cell.report.markup import Tone, masthead, section, steps, table, verdict_box
from cell.report.markup import page as document
from drivers.files import write_file

TONES: dict[Kind, Tone] = {
    "named": "good",
    "no_gap": "good",
    "ambiguous": "fair",
    "unexplained": "bad",
}
STYLE = """<style>
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.p { font-size: .92em; } summary { cursor: pointer; } tr.best { background: var(--wash); }
main svg { height: auto; } .wide table { width: auto; }
</style>"""


def write_report(found: Findings, verdict: Verdict, path: Path) -> None:
    """Write the page at `path`."""
    write_file(path, page(found, verdict))


def page(found: Findings, verdict: Verdict) -> str:
    """The page as text: the card, the picture, and below them all numbers."""
    runs, held = len(found.subject.runs), len(verdict.held_out)
    name = found.subject.name
    title = f"{name}: simulation against {runs} measured runs, {held} of them held out"
    notes = "".join(f"<p class='note'>{escape(note)}</p>" for note in verdict.notes)
    parts = [
        STYLE,
        masthead(title, name),
        _card(found, verdict),
        _following(found, verdict),
        notes,
        section("Before and after, on runs that were held out", compare_held_out(found, verdict)),
        section("Where they disagree", where(found)),
        section("What remains", remains(found, verdict)),
        section("How well the runs repeat", repeats(found)),
        section("What to measure next", _experiments(verdict)),
        section("Candidates", candidates(found, verdict)),
        section("The refitted base", base(found, verdict)),
        _foot(found, verdict),
    ]
    return document(f"{name}: simulation and measurement", parts)


def _card(found: Findings, verdict: Verdict) -> str:
    """The verdict in large: what, how big, and how much of the gap it closes."""
    number, below = "", ""
    if verdict.effects and verdict.gap.before["excess"]:
        number, below = f"{100 * verdict.gap.shrink:.0f} %", "of the gap closed"
    lines = [sentence(found, verdict)]
    tone = TONES[verdict.verdict]
    if verdict.deviates:
        tone = "bad" if tone == "bad" else "fair"
        lines = [capital(deviation(verdict.deviates)) + ".", *lines]
    return verdict_box(tone, headline(verdict), lines, number, below)


def _following(found: Findings, verdict: Verdict) -> str:
    """The command to type next, in the folder where the fit was called."""
    name = f"--strip configs/strips/{found.subject.name}.yaml"
    if isinstance(found.subject, EditsModel):
        name = "--model FILE"
    todo = []
    if verdict.verdict == "named":
        todo += [f"`cell gap accept OUT {name}` puts it into the file; `cell gap undo OUT {name}` "
                 "takes it back."]  # fmt: skip
    elif verdict.deviates and not found.accepted.model.effects:
        todo += [f"`cell gap accept OUT {name}` puts the refitted values into the file, and `cell "
                 f"gap undo OUT {name}` takes them back. If these runs are of another strip, name "
                 "its file instead."]  # fmt: skip
    if verdict.verdict == "ambiguous":
        todo += ["`cell gap advise OUT` says which run would split them."]
    if found.offered is not None:
        law, what = found.offered, "No name, but a description"
        if verdict.verdict == "named":
            what = "The name may imitate another cause; a description that does as well"
        todo += [f"{what}: {law.words}. It closes {100 * law.shrink:.0f} % of the gap on held-out "
                 f"runs; `cell gap accept OUT {name} --law` adds it, `cell gap undo` takes it "
                 "back."]  # fmt: skip
    return steps(todo) if todo else ""


def _experiments(verdict: Verdict) -> str:
    """Planned runs that would separate the explanations, where that would change something."""
    if verdict.verdict in ("named", "no_gap") and not verdict.ambiguous:
        return ""
    if not verdict.advice:
        return "<p>No planned experiment would separate more than these runs do.</p>"
    rows = [
        (a.experiment, f"{name_model(a.separates[0])} from {name_model(a.separates[1])}",
         f"{a.expected_sigma:.1f}", f"{a.minutes:.1f}")
        for a in verdict.advice[:5]
    ]  # fmt: skip
    return table(("experiment", "separates", "sigma", "minutes"), rows)


def _foot(found: Findings, verdict: Verdict) -> str:
    held = [run for run in found.subject.runs if run.name in verdict.held_out]
    return (
        f"<p class='note'>{verdict.simulations} simulated runs in {verdict.runtime:.0f} s. "
        f"Held out: {escape(', '.join(conditions(held)))}.</p>"
    )
