"""The report of a fit, `report.html`: one self-contained page for a technician."""

from pathlib import Path

from cell.gap.report.evidence import base, candidates, name_model, where
from cell.gap.report.held_out import compare_held_out, conditions, remains
from cell.gap.report.repeats import repeats
from cell.gap.report.sentence import capital, deviation, headline, sentence
from cell.gap.subject.subject import EditsModel
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Kind, Verdict
from cell.report.kit import Tone
from cell.report.kit import page as document
from cell.report.verdict import Verdict as Card
from drivers.files import write_file

TONES: dict[Kind, Tone] = {
    "named": "good",
    "no_gap": "good",
    "ambiguous": "fair",
    "unexplained": "bad",
}


def write_report(found: Findings, verdict: Verdict, path: Path) -> None:
    """Write the report page at `path`."""
    write_file(path, page(found, verdict))


def page(found: Findings, verdict: Verdict) -> str:
    """HTML text of the report: the verdict card, figures, and below them all numbers."""
    runs, held = len(found.subject.runs), len(verdict.held_out)
    name = found.subject.name
    return document(
        "gap/report/gap.html",
        f"{name}: simulation and measurement",
        title=f"{name}: simulation against {runs} measured runs, {held} of them held out",
        name=name,
        said=_verdict_card(found, verdict),
        following=_next_commands(found, verdict),
        notes=verdict.notes,
        held=compare_held_out(found, verdict),
        where=where(found),
        remains=remains(found, verdict),
        repeats=repeats(found),
        experiments=_experiments_table(verdict),
        candidates=candidates(found, verdict),
        base=base(found, verdict),
        foot=_provenance(found, verdict),
    )


def _verdict_card(found: Findings, verdict: Verdict) -> Card:
    """Verdict card in large print: the effect, its size, and the share of the gap it closes."""
    number, below = "", ""
    if verdict.effects and verdict.gap.before["excess"]:
        number, below = f"{100 * verdict.gap.shrink:.0f} %", "of the gap closed"
    lines = [sentence(found, verdict)]
    tone = TONES[verdict.verdict]
    if verdict.deviates:
        tone = "bad" if tone == "bad" else "fair"
        lines = [capital(deviation(verdict.deviates)) + ".", *lines]
    return Card(tone, headline(verdict), tuple(lines), number, below)


def _next_commands(found: Findings, verdict: Verdict) -> list[str]:
    """Sentences on the commands to type next, for the folder where the fit was called."""
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
        law, title = found.offered, "No name, but a description"
        if verdict.verdict == "named":
            title = "The name may imitate another cause; a description that does as well"
        todo += [f"{title}: {law.words}. It closes {100 * law.shrink:.0f} % of the gap on held-out "
                 f"runs; `cell gap accept OUT {name} --law` adds it, `cell gap undo` takes it "
                 "back."]  # fmt: skip
    return todo


def _experiments_table(verdict: Verdict) -> list[tuple[str, ...]] | None:
    """Rows of planned runs that would separate explanations; None where nothing is open."""
    if verdict.verdict in ("named", "no_gap") and not verdict.ambiguous:
        return None
    return [
        (a.experiment, f"{name_model(a.separates[0])} from {name_model(a.separates[1])}",
         f"{a.expected_sigma:.1f}", f"{a.minutes:.1f}")
        for a in verdict.advice[:5]
    ]  # fmt: skip


def _provenance(found: Findings, verdict: Verdict) -> str:
    held = [run for run in found.subject.runs if run.name in verdict.held_out]
    return (
        f"{verdict.simulations} simulated runs in {verdict.runtime:.0f} s. "
        f"Held out: {', '.join(conditions(held))}."
    )
