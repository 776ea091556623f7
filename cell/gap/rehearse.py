"""Rehearsal of a fit: each effect is hidden in turn in simulated copies of measured
runs.

A copy has the paths, the noise and the scatter of the runs and the strip as they were
fitted; one effect is hidden in it, as large as it must be to matter, or none. What the
workflow says of the copies is what it could have said of the runs.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cell.base.campaign.journal import Record
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import Engine, Part, carry_out
from cell.base.campaign.versions import verdicts
from cell.gap.effect_size import GapModel, draw_strengths, indistinguishable_from
from cell.gap.fit import fit
from cell.gap.fitting.base_fit import refit_base
from cell.gap.fitting.model import Model
from cell.gap.fitting.reml import reml_spreads
from cell.gap.subject.run_folders import find_runs, without_copies
from cell.gap.subject.strip.measurement_errors import KNOWN_EFFECTS
from cell.gap.subject.strip.runs import MeasuredRun, read_runs
from cell.gap.subject.strip.scope import fitted_strip
from cell.gap.subject.strip.subject import StripSubject
from cell.gap.subject.strip.synthetic import rod_folds, write_fold
from cell.report.words import plain
from drivers.base.files import replace_file
from drivers.base.settings import Settings
from drivers.base.types import frozen
from drivers.strip.describe import describe, load_strip
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import GripperPath

JOURNAL, PAGE = "journal", "rehearsal.md"
NO_EFFECT = "nothing"
EXCESS = 2.5  # sigma that a hidden effect leaves beside the refitted base
EMPTY_COPIES = 5  # with nothing hidden
COPY_COST = 30.0  # s of one core, about
SEGMENTS = 240  # of the copies' rod: finer than any grid of the model
STEP = 0.002  # s, of that rod
DWELL_TIME = 0.6  # s that a copy stays at the end of its path
ROW_PERIOD = 0.01  # s between the rows of that stay


class HiddenCopy(Settings):
    """One simulated copy of the runs: its hidden `effect` with `values`, and its random
    `seed`.
    """

    key: str
    effect: str
    values: dict[str, float]
    seed: int


class Plan(Settings):
    """Plan of a rehearsal: the refitted strip, its run-to-run spreads, the copies to
    simulate.

    `unseen` are effects that leave no such gap at any believable size.
    """

    file: str
    runs: tuple[str, ...]
    base: dict[str, float]
    scatter: dict[str, float]
    copies: tuple[HiddenCopy, ...]
    unseen: tuple[str, ...]


def rehearsal_plan(paths: Sequence[Path], file: Path, jobs: int) -> Plan:
    """Plan of a rehearsal of the runs at `paths`, by a refit of the strip in `file`.

    It has every effect of the library at the size that leaves an excess gap of EXCESS,
    and EMPTY_COPIES with nothing hidden. Raises ConfigurationError for what is no
    strip.
    """
    folders, _ = without_copies(find_runs(paths))
    strip = load_strip(file)
    measured = read_runs(folders, strip)
    subject = StripSubject(strip, measured, jobs)
    parameters = subject.scope.base
    base = refit_base(subject.simulate, Model(parameters), subject.runs)
    pairs = zip(parameters, base.shared, strict=True)
    values = {p.name: p.stated_value(v) for p, v in pairs}
    usable = [run for run in measured if run.usable]
    copies, unseen = _copies_with_each_effect(fitted_strip(strip, values), usable)
    copies_without_effect = [
        HiddenCopy(key=f"{NO_EFFECT}-{i}", effect=NO_EFFECT, values={}, seed=i)
        for i in range(EMPTY_COPIES)
    ]
    return Plan(
        file=str(file.resolve()),
        runs=tuple(str(run.path) for run in folders),
        base=values,
        scatter={s.name: s.value for s in reml_spreads(base)},
        copies=(*copies, *copies_without_effect),
        unseen=tuple(unseen),
    )


def _path_of_run(run: MeasuredRun) -> GripperPath:
    """Measured gripper path of a run, with a standstill of DWELL_TIME added for a late
    touch.
    """
    rows = round(DWELL_TIME / ROW_PERIOD)
    t = run.t - run.t[0]
    times = np.append(t, t[-1] + ROW_PERIOD * np.arange(1, rows + 1))
    poses = np.pad(run.poses, ((0, rows), (0, 0)), mode="edge")
    return GripperPath(frozen(times), frozen(poses), run.hanging)


def _copies_with_each_effect(
    strip: StripFile, runs: Sequence[MeasuredRun]
) -> tuple[list[HiddenCopy], list[str]]:
    """Copies of the runs with one hidden effect each, just large enough to leave an
    excess residual of EXCESS sigma.

    Effects that the refitted `strip` has already are left out; the noise is that of the
    first run. Second, the names of the effects that leave such a gap at no believable
    size.
    """
    gap_model = GapModel.along(strip, [*map(_path_of_run, runs)], runs[0].sigma)
    copies = []
    unseen = []
    for seed, (name, effect) in enumerate(sorted(registry().items())):
        if name in strip.effects:
            continue
        strengths = draw_strengths(effect, strip, np.random.default_rng([seed]))
        fraction = gap_model.fraction(strengths, EXCESS)
        if fraction:
            values = strengths.at(fraction)
            copies.append(HiddenCopy(key=name, effect=name, values=values, seed=seed))
        else:
            unseen.append(name)

    return copies, unseen


def _diagnose_copy(plan: Plan, hidden: HiddenCopy) -> Mapping[str, Any]:
    """Simulate a copy of the runs and fit it; returns hidden effect and verdict as
    plain values.
    """
    with TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        runs = folder / "runs"
        write_copy(plan, hidden, runs)
        verdict = fit([runs], Path(plan.file), folder / "out")
    effects = verdict.effects
    return {
        "hidden": hidden.effect,
        "values": hidden.values,
        "verdict": verdict.verdict,
        "named": [effect.name for effect in effects],
        "classes": verdict.ambiguous,
        "confidence": min((effect.confidence for effect in effects), default=None),
    }


def write_copy(plan: Plan, hidden: HiddenCopy, folder: Path) -> None:
    """Simulate a copy of the planned runs and write its run folders into `folder`."""
    strip = load_strip(Path(plan.file))
    rng = np.random.default_rng([hidden.seed, 1])
    measured = read_runs(find_runs([*map(Path, plan.runs)]), strip)
    runs = [run for run in measured if run.usable]
    effects = {hidden.effect: hidden.values} if hidden.values else {}
    fitted = fitted_strip(strip, plan.base)
    models = [
        _with_scatter(describe(fitted, effects, run.index), plan.scatter, rng)
        for run in runs
    ]
    folds = rod_folds(models, [*map(_path_of_run, runs)], SEGMENTS, STEP)

    for number, (run, fold) in enumerate(zip(runs, folds, strict=True)):
        copy = replace(fold, index=run.index, condition=run.condition)
        noise = run.sigma
        if not run.has_force:
            noise = noise.model_copy(update={"force": None})
        write_fold(
            folder=folder / f"{number:02d}",
            strip=strip.name,
            fold=copy,
            noise=noise,
            rng=rng,
        )


def _with_scatter(
    model: StripModel, scatter: Mapping[str, float], rng: np.random.Generator
) -> StripModel:
    """Strip model of one run, with run-to-run differences drawn from the spreads
    `scatter`.
    """
    for effect in KNOWN_EFFECTS:
        if effect.name in scatter:
            model = effect.apply(model, rng.normal(0.0, scatter[effect.name]))
    return model


def rehearse(plan: Plan, folder: Path, engine: Engine, meter: Meter) -> list[Record]:
    """Fit all copies of `plan`, resuming from the journal in `folder`; returns their
    records.
    """
    version = hashlib.sha256(
        f"{plan.model_dump_json()}{verdicts()}".encode()
    ).hexdigest()[:16]
    parts = [
        Part(
            key=hidden.key,
            of=version,
            cost=COPY_COST,
            function=_diagnose_copy,
            arguments=(plan, hidden),
        )
        for hidden in plan.copies
    ]
    return list(carry_out(parts, folder / JOURNAL, engine, meter))


def is_right(outcome: Mapping[str, Any]) -> bool:
    """Whether a verdict names the hidden effect or its class; no gap if none is
    hidden.
    """
    name = outcome["hidden"]
    if name == NO_EFFECT:
        return bool(outcome["verdict"] == "no_gap")
    acceptable = {name, *indistinguishable_from(name)}
    if named := outcome["named"]:
        return acceptable.issuperset(named)
    return any(not acceptable.isdisjoint(group) for group in outcome["classes"])


def progress_line(record: Record) -> str:
    """Short text of the verdict on a copy, or of its failure, for the progress
    report.
    """
    return (
        f": {_answer(record.outcome) if record.outcome else f'failed: {record.reason}'}"
    )


def _answer(outcome: Mapping[str, Any]) -> str:
    """Short text of the verdict on a copy: names with confidence, classes of effects,
    or the kind of verdict.
    """
    named = ", ".join(outcome["named"])
    if not named:
        groups = "; ".join(" or ".join(group) for group in outcome["classes"])
        return groups or plain(outcome["verdict"])
    return f"{named}, confidence {outcome['confidence']:.2f}"


def page(plan: Plan, records: Sequence[Record]) -> str:
    """Markdown page of a rehearsal: which effects could be named, which names are
    false.
    """
    hidden = []
    empty = []
    rows = []
    for o in (record.outcome for record in records if record.outcome):
        name = o["hidden"]
        if name == NO_EFFECT:
            empty.append(o)
            continue
        hidden.append(o)
        size = ", ".join(f"{key} {v:.3g}" for key, v in o["values"].items())
        right = "yes" if is_right(o) else "**no**"
        rows.append((name, size, _answer(o), right))

    parts = [
        f"# Rehearsal of {len(plan.runs)} runs",
        *_summary(plan, hidden, empty),
        table(("hidden", "size", "said", "right"), rows),
    ]
    return "\n\n".join(parts) + "\n"


def _summary(
    plan: Plan, hidden: Sequence[Mapping[str, Any]], empty: Sequence[Mapping[str, Any]]
) -> Iterator[str]:
    """Sentences on the numbers of hidden effects that would be named and of false
    names.
    """
    good = sum(map(is_right, hidden))
    alarms = sum(bool(o["named"]) for o in empty)
    sure = [o["confidence"] for o in hidden if o["named"] and is_right(o)]
    yield (
        f"Of {len(hidden)} effects, each hidden so large that it matters, {good} would"
        " have been named or held in a class"
        + (f", at a confidence of {mean(sure):.2f}" if sure else "")
        + f". With nothing hidden, {alarms} of {len(empty)} copies were given a name."
    )
    if plan.unseen:
        yield f"At no believable size do these runs show: {', '.join(plan.unseen)}."
    yield "Of other runs it says nothing."


def write_page(plan: Plan, records: Sequence[Record], folder: Path) -> Path:
    """Write page and outcomes of a rehearsal into `folder`; returns the path of the
    page.
    """
    outcomes = [dict(record.outcome) for record in records if record.outcome]
    replace_file(folder / "rehearsal.json", json.dumps(outcomes, indent=1).encode())
    place = folder / PAGE
    replace_file(place, page(plan, records).encode())
    return place


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table with the columns `head` and the given `rows`."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
