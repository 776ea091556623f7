"""Verdict on a run at the head of its page: headline, numbers of weight, what to do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cell.record.events import NOT_LEARNED
from cell.record.files import RESULT, is_under_way
from cell.record.header import LAID, UNMEASURED, Result
from cell.record.listing import earlier_results
from cell.record.run import Run
from cell.report.html import Card, Tone
from cell.report.words import millimetres, outcome_title, plural, seconds
from drivers.base.errors import in_mm

# events that an operator should know of
WARNINGS = frozenset({"camera_unwatched", NOT_LEARNED})
# m of displacement to count as folded (Petrik and Kyrki, IROS 2019)
FOLDED_TOLERANCE = 0.020
EARLIER_FOLDS = 20  # beside which a fold's numbers are drawn
LEAST_FOLDS = 3  # from which on a fold is normal or not among them
USUAL = 2.0  # sigma, within which 19 of 20 numbers lie
FORETOLD = "layers, against their prediction"
LEAST_SCALE = 0.002  # m, to which numbers are drawn at least


def verdict(run: Run) -> str:
    """Text of the verdict on `run` in one line, from its record without the truth."""
    said = verdict_of(run, is_under_way(run.folder))
    return f"{run.header.strip}: {said.headline}. {' '.join(said.sentences[:1])}"


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """Main number on a fold with its `sigma`, its `true` value on the twin, and those
    of `earlier` folds, each [m].
    """

    name: str
    value: float
    sigma: float
    true: float | None
    earlier: tuple[float, ...]

    @property
    def tolerance(self) -> str:
        """Words on the direction of the fold's number, its tolerance and its true
        value.
        """
        side = "too far" if self.value > 0 else "short"
        true = ""
        if self.true is not None:
            true = f"; true on the twin {millimetres(self.true, signed=True)}"
        return f"{side}, {self.margin}{true}"

    @property
    def margin(self) -> str:
        """Words on the error of the fold's number, or on how large such a difference
        usually is.
        """
        if self.name == FORETOLD:
            return f"up to {millimetres(USUAL * self.sigma)} is usual"
        return f"± {millimetres(self.sigma)}"

    @property
    def text(self) -> str:
        """Text of the fold's number in millimetres."""
        return millimetres(self.value, signed=True)

    @property
    def history(self) -> str:
        """Words on the same number of earlier folds; empty where there are none."""
        earlier = self.earlier
        if not earlier:
            return ""
        ends = (min(earlier), max(earlier))
        texts = (millimetres(end, signed=True) for end in ends)
        span = " to ".join(dict.fromkeys(texts))
        return f"{plural(len(earlier), 'fold')} before: {span}"

    def standing(self, usual: Sequence[float]) -> str:
        """Words on whether the number lies among `usual` ones [m], as far as it is
        known.
        """
        error = USUAL * self.sigma
        is_normal = min(usual) - error <= self.value <= max(usual) + error
        return "Normal" if is_normal else "Not as usual"

    @property
    def place(self) -> float:
        """Position at which the page draws the fold's number on a scale from -100 to
        100.
        """
        return self._placed(self.value)

    @property
    def others(self) -> list[float]:
        """Positions at which the page draws the numbers of earlier folds on a scale
        from -100 to 100.
        """
        return [self._placed(value) for value in self.earlier]

    def _placed(self, value: float) -> float:
        largest = max(map(abs, (self.value, *self.earlier, LEAST_SCALE)))
        return round(100 * value / largest, 1)


def key_figures(run: Run, truth: Mapping[str, Any]) -> list[KeyFigure]:
    """Main numbers on a fold, such as the offset of its edges, with the simulated
    strip's `truth` on the twin; empty where nothing was measured.
    """
    own = run.result
    if own is None or own.displacement is None:
        return []
    header, sigma = run.header, run.header.sigma
    earlier = earlier_results(run.folder, header.strip, header.policy, EARLIER_FOLDS)
    folds = [own, *earlier]
    surprises = [*map(_surprise, folds)]
    numbers: dict[str, tuple[float, float | None, list[float | None]]] = {
        "edges, once laid down": (
            sigma.edge_offset or sigma.displacement,
            truth.get("edge_offset"),
            [fold.edge_offset for fold in folds],
        ),
        "layers, at their first touch": (
            sigma.displacement,
            truth.get("displacement"),
            [fold.displacement for fold in folds],
        ),
        FORETOLD: (surprises[0][1], None, [surprise for surprise, _ in surprises]),
    }
    found = []
    for name, (error, true, (value, *others)) in numbers.items():
        before = tuple(other for other in others if other is not None)
        if value is not None:
            found.append(KeyFigure(name, value, error, true, before))
    return found


def _standing(run: Run) -> str:
    """Sentence on whether a fold is normal: among those before it or, of too few,
    beside its prediction.
    """
    numbers = key_figures(run, {})
    first, last = numbers[0], numbers[-1]
    header = run.header
    of = f"of {header.strip} by {header.policy or 'another program'}"
    count = len(first.earlier)
    if count >= LEAST_FOLDS and first.sigma < UNMEASURED:
        return f"{first.standing(first.earlier)} for a fold {of}: {first.history}."

    few = f"{plural(count, 'earlier fold')} {of} to compare with"
    if last.name != FORETOLD:
        return f"Normal or not is unknown: nothing was predicted, {few}."
    off = f"{last.text} from the prediction, {last.margin}"
    return f"{last.standing((0.0,))}: the layers touch {off} ({few})."


def _surprise(fold: Result) -> tuple[float | None, float]:
    """Difference of the displacement of a `fold` from its prediction, None where
    nothing was predicted, and its spread [m].
    """
    notes = (note for note in fold.witnesses if note.name == "displacement")
    return next(((note.difference, note.spread) for note in notes), (None, 0.0))


def verdict_of(run: Run, under_way: bool = False) -> Card:
    """Verdict on `run`, without the truth that only the twin knows."""
    if under_way:
        return Card("fair", "Still under way", (_last_seen(run, "so far"),))
    result = run.result
    if result is None:
        return _verdict_without_result(run)
    if result.displacement is None:
        return _without_displacement(run, result)
    return _fold_verdict(run, result, result.displacement)


def _fold_verdict(run: Run, result: Result, displacement: float) -> Card:
    """Verdict on a fold: what to do, then what an operator should know."""
    line, doubts = run.header.line, _doubts(result)
    tone = _fold_tone(result, displacement, doubts)
    warnings = [
        _sentence(str(event.facts.get("reason")))
        for event in run.events()
        if event.kind in WARNINGS
    ]
    return Card(
        tone=tone,
        headline=_fold_headline(result, is_half=line is None),
        sentences=(
            _standing(run),
            *(doubts or [_next_step(run, tone)]),
            *([] if line is None else [_line_sentence(line)]),
            *warnings,
        ),
    )


def _doubts(result: Result) -> list[str]:
    """Sentences on what casts doubt on a fold's result, each with what to
    do about it.
    """
    agreement = result.agreement
    reasons: list[str | None] = [note.reason for note in result.witnesses]
    if agreement is not None and not agreement.like_model:
        reasons.append(agreement.reason)
    if result.outcome != "layer_touch":
        reasons.insert(0, result.reason)
    return [_sentence(reason) for reason in dict.fromkeys(reasons) if reason]


def _fold_tone(result: Result, displacement: float, doubts: Sequence[str]) -> Tone:
    """Tone of a fold: good within FOLDED_TOLERANCE, fair beyond it or if doubted, bad
    if another end stopped it.
    """
    if result.outcome not in ("layer_touch", *LAID):
        return "bad"
    largest = max(abs(displacement), abs(result.edge_offset or 0.0))
    return "fair" if doubts or largest > FOLDED_TOLERANCE else "good"


def _next_step(run: Run, tone: Tone) -> str:
    """Sentence on what to do after a fold that nothing speaks against."""
    within = f"the {in_mm(FOLDED_TOLERANCE)} that count as folded"
    if tone == "good":
        return f"Next: nothing to mend, it lies within {within}."
    strip = run.header.strip
    return f"Next: `cell gap plan --strip {strip}` finds why it lies beyond {within}."


def _line_sentence(line: float) -> str:
    """Sentence on a fold whose crease is to lie `line` [m] from the grasped edge."""
    return (
        f"Folded along a line {millimetres(line)} from the grasped edge, to which all"
        " lengths below are relative."
    )


def _fold_headline(result: Result, *, is_half: bool) -> str:
    """Headline on a fold: how far the edges lie apart, or when the layers touched."""
    if result.outcome != "layer_touch":
        return outcome_title(result.outcome)
    if result.edge_offset is None:
        return f"Folded: the layers touched after {seconds(result.t_layer_touch)}"
    off = millimetres(abs(result.edge_offset))
    if is_half:
        return f"Folded: the edges lie {off} apart"
    return f"Folded: the edge lies {off} off its place"


def _without_displacement(run: Run, result: Result) -> Card:
    """Verdict on a run that ended without a displacement."""
    done = result.outcome == "path_done"
    sentences = [_sentence(result.reason), _last_seen(run, "at the end")]
    if done:
        sentences.append("No touch was seen, so no displacement is claimed.")
    else:
        sentences.append(
            "A fault never resumes a motion: clear its cause, look at the strip, "
            "and start a new run."
        )
    said = tuple(filter(None, sentences))
    return Card("fair" if done else "bad", outcome_title(result.outcome), said)


def _verdict_without_result(run: Run) -> Card:
    """Verdict on a run whose result is broken, or whose process died before it wrote
    one.
    """
    ticks = run.ticks
    if (run.folder / RESULT).exists():
        unread = f"What {RESULT} holds cannot be read."
        sentences = (unread, _last_seen(run, "at the last row"))
        headline = "How the run ended cannot be read"
        return Card("bad", headline, tuple(filter(None, sentences)), spoilt=True)
    if ticks.t.size == 0:
        sentence = "The process died before the arm moved; nothing was measured."
        return Card("bad", "The process died at the start", (sentence,))
    state = f" in state {ticks.state[-1]}" if ticks.state else ""
    headline = f"The process died at t = {seconds(ticks.t[-1])}{state}"
    return Card("bad", headline, (_last_seen(run, "then"), "There is no result."))


def _sentence(reason: str | None) -> str:
    """Sentence made of a `reason`, with capital letter and full stop; empty for
    none.
    """
    return f"{reason[:1].upper()}{reason[1:].rstrip('.')}." if reason else ""


def _last_seen(run: Run, when: str) -> str:
    """Sentence on the gripper's last recorded position; empty without ticks."""
    if run.ticks.t.size == 0:
        return ""
    x, z = millimetres(run.ticks.x[-1]), millimetres(run.ticks.z[-1])
    return f"The gripper stood {when} at x {x}, z {z}."
