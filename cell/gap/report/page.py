"""Report page of a fit, `report.html`, self-contained and for a technician."""

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting.base_fit import undetermined_values
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.report import figures
from cell.gap.report.sentence import (
    capitalised,
    detection_limit,
    deviation_text,
    effect_title,
    headline,
    in_small_unit,
    interval_numbers,
    interval_text,
    motion_name,
    number_text,
    probability_text,
    quantity_label,
    scatter_rows,
    sentence,
    shown_unit,
    undetectable_effects,
    usual_size,
)
from cell.gap.selection.likelihood import MIN_GAIN
from cell.gap.subject.subject import FitRun
from cell.gap.verdict.compose import significant
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.offered_law import OfferedLaw
from cell.gap.verdict.schema import CandidateEntry, Gap, Kind, Verdict
from cell.report.html import Card, Tone, page as document
from cell.report.words import (
    NO_VALUE,
    millimetres,
    plain,
    seconds,
)
from drivers.base.errors import CellError, in_percent
from drivers.base.settings import parse
from drivers.strip.file import StripFile
from policies.planned import fold_by_plan

LISTED_EXPERIMENTS = 5  # runs of which the page advises
PACKAGES = ("folding-cell", "numpy", "scipy", "mujoco")
METHOD = (
    "Each run is simulated from the measured motion of its gripper or joints; the"
    " residual is what was measured less what was simulated, in samples with the noise"
    " that the run states.",
    "Base values are fitted with priors about the file by Gauss-Newton steps, with"
    " Huber's loss (Huber 1964, Ann. Math. Stat. 35).",
    "What differs from run to run is estimated beside them by restricted likelihood"
    " (Patterson and Thompson 1971, Biometrika 58, 545).",
    "Where residuals remain is tested in all places at once by draws of the noise"
    " (Westfall and Young 1993; Davison and Hinkley 1997, section 6.3).",
    "Every effect of the library is tried alone, the best ones together; each set is"
    " judged by how well it predicts runs, or motions, that were left out of its fit.",
    "The probability of a set is its posterior over all fitted sets, with an error of"
    " each law that is smooth in time (George and McCulloch 1993, J. Am. Stat. Assoc."
    " 88, 881; Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63, 425).",
    "It counts causes outside the library, calibrated on hidden effects (Platt 1999).",
    "Runs are held out before the first fit; they name nothing, and judge what was"
    " named.",
    "A run to measure next is the one in which the models that are left differ most"
    " (Box and Hill 1967).",
)
TONES: dict[Kind, Tone] = {
    "named": "good",
    "no_gap": "good",
    "ambiguous": "fair",
    "unexplained": "bad",
}


def _place_values(findings: Findings) -> dict[str, str]:
    """Values for the page's template on where residuals exceed noise most: a sentence
    under `words`, a figure under `map`.
    """
    places = findings.places
    words = "Nowhere beyond what noise does."
    strong = significant(places)
    for first in strong[:1]:
        words = (
            f"Strongest in {first.channel}, {first.zone} zone, {first.phase} phase of"
            f" {motion_name(first.condition)}: {abs(first.z):.0f} sigma. {len(strong)}"
            f" of {len(places)} places disagree beyond noise (dots; family-wise 5 %)."
            " Shown is the model after its base parameters were refitted."
        )
    return {"words": words, "map": figures.heat_map(places)}


def _candidate_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Values for the page's template on all models that were fitted, with how much
    better [nats] each predicts runs that it has not seen.
    """
    accepted = findings.accepted
    note = (
        "What each effect gains in predicting runs that the fit had not seen, in nats."
        " Accepted is the most probable set of effects that predicts better than each"
        f" of its subsets, beyond errors of laws, and leads each by {MIN_GAIN:.0f} nats"
        " or more (55 times as probable)."
    )
    return {
        "note": note,
        "found": bool(accepted.effects),
        "dead": ", ".join(p.name for p in findings.screen.probed if p.dead),
        "rows": [
            _candidate_row(row, row.name == accepted.name) for row in verdict.candidates
        ],
    }


def _candidate_row(row: CandidateEntry, best: bool) -> dict[str, Any]:
    """Values for the page's template on one tried effect: its name, gain, standard
    error, p-value and parameters.
    """
    scatter = f"{row.se:.1f}" if row.se else NO_VALUE  # none where it was only screened
    return {
        "name": row.name,
        "best": best,
        "numbers": (f"{row.elpd_gain:.1f}", scatter, probability_text(row.p)),
        "parameters": [
            f"{name} {interval_text(value)}" for name, value in row.parameters.items()
        ],
    }


def _base_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Values for the page's template on the parameters of the fitted file: a row for
    each with its stated and its fitted value, and a note.
    """
    weak = ", ".join(p.name for p, _ in undetermined_values(findings.base))
    note = f"The runs add little to what was known before of: {weak}."
    rows = []
    for p in findings.scope.base:
        name = p.name
        unit = p.unit
        start = number_text(in_small_unit(p.start, unit), 4)
        refitted, *ends = interval_numbers(verdict.base[name], unit, 4)
        rows.append((name, start, refitted, " to ".join(ends), shown_unit(unit)))

    return {
        "rows": rows,
        "note": note if weak else "The runs at least halve what was uncertain of each.",
    }


def _held_out_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Values for the page's template on held-out runs before and after effects were
    added: figures, a sentence and a table.
    """
    fits = findings.held_out_fits.by_key
    names = conditions(fits["before"].runs)
    by_run = {
        word: held_out_gap.excess(held_out_gap.run_squares(fit)[:, None])
        for word, fit in fits.items()
    }
    before = by_run["before"]
    typical = np.argsort(before)[len(names) // 2]
    largest = int(np.argmax(before))
    return {
        "worst": _worst_values(findings, fits, largest, names[largest]),
        "typical": names[typical],
        "traces": figures.residual_traces(fits, typical, findings.quantities),
        "says": capitalised(verdict.held_out_sentence),
        "head": ("rms", *fits, "noise", "sigma beyond"),
        "rows": list(_held_out_rows(findings, verdict.gap)),
        "leaves": any(excess.any() for excess in by_run.values()),
        "bars": figures.run_bars(names, by_run) if len(names) > 1 else "",
    }


def _worst_values(
    findings: Findings, fits: Mapping[str, FitEstimate], run: int, name: str
) -> dict[str, str]:
    """Values for the page's template on the worst moment of the held-out run with the
    index `run`: a figure and a sentence.
    """
    drawn = {word: fit.on([run]) for word, fit in fits.items()}
    replays = list(figures.replay_runs(findings.subject, drawn, held_out=True))
    worst = figures.worst_moment(replays)
    if not worst:  # a mechanism has no curve
        return {
            "figure": figures.residual_traces(fits, run, findings.quantities),
            "says": f"Measured minus simulated in {name}, which the fit had not seen.",
        }

    before, after = (millimetres(worst.off.get(key)) for key in ("before", "after"))
    found = f", {after} with what was found" if "after" in worst.off else ""
    says = (
        f"The worst moment, {seconds(worst.t)} into {name}, a run kept back from the"
        f" fit: the simulated strip is {before} off with the refitted file{found}."
    )
    return {"figure": figures.worst_picture(worst), "says": says}


def _sizes(verdict: Verdict) -> list[tuple[str, str, str]]:
    """Table rows on each parameter of the effects that are named or suspected: name,
    value, and 95 % interval.
    """
    rows = []
    every = [(effect, "") for effect in verdict.effects]
    every += [(effect, "suspected, ") for effect in verdict.suspected]
    for effect, doubt in every:
        of = f"{doubt}{effect_title(effect)}"
        for name, value in effect.parameters.items():
            unit = value.unit
            size, *ends = interval_numbers(value, unit)
            shown = f"{size} {shown_unit(unit)}".strip()
            rows.append((f"{of}: {plain(name)}", shown, " to ".join(ends)))

    return rows


def _held_out_rows(findings: Findings, gap: Gap) -> Iterator[tuple[str, ...]]:
    """Table rows, one for each measured quantity, with the residual of each fit to
    held-out runs, the noise, and by how much each fit exceeds it.
    """
    quantities = findings.quantities
    fits = findings.held_out_fits.by_key
    sides = [*(getattr(gap, word) for word in fits), gap.floor]
    beyond = [held_out_gap.excess_by_quantity(fit, quantities) for fit in fits.values()]
    words = {
        quantity.key: f"{quantity_label(quantity)} [{quantity.unit}]"
        for quantity in quantities.values()
    }
    for key in (key for key in beyond[0] if key in gap.before):
        rms = (f"{side[key]:.3g}" for side in sides)
        yield words[key], *rms, " then ".join(f"{side[key]:.2g}" for side in beyond)


def conditions(runs: Sequence[FitRun]) -> list[str]:
    """Short names of `runs` by their motion, such as `fast`, with numbers for
    repeats.
    """
    short = [motion_name(run.condition) for run in runs]
    return [
        name if short.count(name) == 1 else f"{name} {short[: i + 1].count(name)}"
        for i, name in enumerate(short)
    ]


def _remaining_values(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Values for the page's template on residuals that the accepted model leaves, and
    on the smallest effects that the runs would have shown.
    """
    known = findings.scope.by_name
    rest = verdict.unexplained
    law = findings.law
    is_open = verdict.verdict == "unexplained"  # then the card describes it
    return {
        "open": is_open,
        "rest": capitalised(rest.description) if rest and not is_open else "",
        "law": _law_text(law) if law else "",
        "alike": "; ".join(" or ".join(group) for group in verdict.ambiguous),
        "untested": [(each.what, each.why) for each in verdict.untested],
        "silent": ", ".join(undetectable_effects(findings)),
        "detectable": [
            (
                name,
                detection_limit(findings, name, value),
                usual_size(findings, name),
                known[name].sentence,
            )
            for name, value in sorted(verdict.detectable.items())
        ],
    }


def _law_text(law: OfferedLaw) -> str:
    """Sentence on the formula that describes an unexplained residual without a cause,
    and on how much of the gap it closes.
    """
    closed = in_percent(law.shrink)
    return (
        f"A law describes it, without a name: {law.words}. It closes {closed} of the"
        " gap on held-out runs."
    )


def page(findings: Findings, verdict: Verdict) -> str:
    """HTML text of the report of a fit: a card with the verdict, figures, and all
    numbers below them.
    """
    subject = findings.subject
    name = subject.name
    runs = subject.runs
    planned = _planned_folds(findings, verdict)
    held = _held_out_values(findings, verdict)
    return document(
        "gap/report/gap.html",
        f"{name}: simulation and measurement",
        title=(
            f"{name}: simulation against {len(runs)} measured runs,"
            f" {len(verdict.held_out)} of them kept back to judge it"
        ),
        name=f"{runs[0].name} to {runs[-1].name}",
        said=_verdict_card(findings, verdict, planned),
        worst=held.pop("worst"),
        sizes=_sizes(verdict),
        following=[f"{capitalised(step.sentence)}." for step in verdict.steps],
        notes=verdict.notes,
        planned=planned,
        held=held,
        where=_place_values(findings),
        remains=_remaining_values(findings, verdict),
        repeats=_scatter_table(findings),
        experiments=_experiments_table(verdict),
        candidates=_candidate_values(findings, verdict),
        base=_base_values(findings, verdict),
        method=METHOD,
        evidence=_evidence(findings, verdict),
        foot=_provenance(findings, verdict),
    )


def _planned_folds(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    """Values for the page's template on simulated folds of the strip, one planned from
    its file and one planned with the accepted effects.

    Empty for mechanisms, where nothing was accepted, and where the rod cannot simulate
    the strip.
    """
    nothing = {"rows": [], "figure": ""}
    subject = findings.subject
    if subject.kind != "strip" or not verdict.effects:
        return nothing

    values = verdict.values_with(verdict.effects)
    patches = (subject.patch(*each, "") for each in (({}, {}), values))
    rows = []
    shapes = {}
    try:
        stated, accepted = (parse(patch, StripFile, "patch") for patch, _ in patches)
        for known, by in ((stated, "from the file"), (accepted, "with what was found")):
            name = f"planned {by}"
            displacement, shapes[name] = fold_by_plan(known, accepted)
            rows.append((name, _off(displacement)))
    except CellError:
        return nothing

    return {"rows": rows, "figure": figures.folds(shapes)}


def _verdict_card(
    findings: Findings, verdict: Verdict, planned: Mapping[str, Any]
) -> Card:
    """Card at the top of the page with the headline and sentences of the verdict, its
    colour, and its probability in large print.
    """
    number = below = ""
    if effects := verdict.effects:
        number = in_percent(min(effect.confidence for effect in effects))
        below = "sure that this is the cause,\nunknown causes counted in"

    lines = [sentence(findings, verdict)]
    rows = planned["rows"]
    if findings.held_out_fits.changed and not rows:
        lines.append(capitalised(verdict.held_out_sentence) + ".")
    if verdict.untested:
        names = ", ".join(each.what for each in verdict.untested)
        lines.append(f"These runs could not show: {names}.")

    tone = TONES[verdict.verdict]
    if verdict.deviates:
        tone = "bad" if tone == "bad" else "fair"
        lines = [capitalised(deviation_text(verdict.deviates)) + ".", *lines]

    said = _fold_sentence(verdict, rows) if rows else headline(verdict)
    return Card(tone, said, tuple(lines), number, below)


def _fold_sentence(verdict: Verdict, rows: Sequence[tuple[str, str]]) -> str:
    """Sentence on where a simulated fold ends that is planned from the strip's file,
    and where one that is planned with the found effects does.
    """
    words = " and ".join(map(effect_title, verdict.effects))
    (_, before), (_, after) = rows
    return (
        f"The model lacks {words}: in simulation, a fold planned from the file ends"
        f" {before} off, with what was found {after} off"
    )


def _off(length: float) -> str:
    """Text of the size of a `length` [m] in millimetres, or `less than 0.1 mm` where a
    camera could not tell it from zero.
    """
    return "less than 0.1 mm" if abs(length) < 5e-5 else millimetres(abs(length))


def _scatter_table(findings: Findings) -> list[tuple[str, ...]] | None:
    """Table rows on quantities that differ from run to run; None for a strip or
    mechanism that has no such quantities.
    """
    if not any(p.random for run in findings.subject.runs for p in run.local):
        return None
    return scatter_rows(findings.model_tests.scatter, findings.scope.scatter)


def _experiments_table(verdict: Verdict) -> list[tuple[str, ...]] | None:
    """Table rows on the runs that are advised next: the run, the models that it
    separates, by how many standard deviations, and its minutes; None where the verdict
    is clear.
    """
    if verdict.verdict in ("named", "no_gap") and not verdict.ambiguous:
        return None
    return [
        (
            advised.experiment,
            " from ".join(advised.separates),
            f"{advised.expected_sigma:.1f}",
            f"{advised.minutes:.1f}",
        )
        for advised in verdict.advice[:LISTED_EXPERIMENTS]
    ]


def _evidence(findings: Findings, verdict: Verdict) -> list[tuple[str, ...]]:
    """Table rows on the files and runs that the fit has read: name, what it is, and for
    files the begin of the SHA-256 digest.
    """
    subject = findings.subject
    rows: list[tuple[str, ...]] = [
        (path.name, "stated by the file", digest[:16])
        for path, digest in subject.origin.digests.items()
    ]
    for run in subject.runs:
        held = "held out" if run.name in verdict.held_out else "fitted"
        rows.append((run.name, f"{motion_name(run.condition)}, {held}", NO_VALUE))
    return rows


def _provenance(findings: Findings, verdict: Verdict) -> str:
    held = [run for run in findings.subject.runs if run.name in verdict.held_out]
    used = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return (
        f"{verdict.simulations} simulated runs in {verdict.runtime:.0f} s, with {used};"
        " the same runs give the same numbers. "
        f"Held out: {', '.join(conditions(held))}."
    )
