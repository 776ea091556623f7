"""Verdict on a run in one to three sentences, at the head of its page."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cell.record.events import NOT_LEARNED
from cell.record.files import RESULT, is_under_way
from cell.record.header import LAID, Result
from cell.record.run import Run
from cell.report.html import Tone
from cell.report.words import millimetres, outcome_title, seconds

LINE_BREAK = "\n"
# events that an operator should know of
WARNINGS = frozenset({"camera_unwatched", NOT_LEARNED})
# m of displacement to count as folded (Petrik and Kyrki, IROS 2019)
FOLDED_TOLERANCE = 0.020


@dataclass(frozen=True, slots=True)
class PageVerdict:
    """Verdict at the head of a page: `headline` states the outcome, `sentences` explain
    it.

    `figure` and `error` are the displacement where there is one; `tone` is its colour.
    """

    tone: Tone
    headline: str
    sentences: tuple[str, ...]
    figure: str = ""
    error: str = ""
    spoilt: bool = False  # the end is not known because result.yaml cannot be read


def sigma_lines(run: Run, *, laid: bool) -> str:
    """Text in two lines: sigma of displacement or `laid` edges, error of the
    calibration.
    """
    sigma = f"± {millimetres(run.header.sigma.displacement)} stated in run.yaml"
    if laid and run.header.sigma.edge_offset is not None:
        sigma = f"± {millimetres(run.header.sigma.edge_offset)} camera"
    calibration, noted = run.calibration(), run.header.calibration
    error = None if noted is None else noted.error
    if calibration is not None:
        error = calibration.residual
    if error is None:
        return f"{sigma}{LINE_BREAK}calibration error not recorded"
    return f"{sigma}{LINE_BREAK}± {millimetres(error)} calibration"


def verdict(run: Run) -> str:
    """Text of the verdict on `run` in one line, from its record without the truth."""
    found = verdict_of(run, None, is_under_way(run.folder))
    figure = (
        f": {found.figure} ({found.error.replace(LINE_BREAK, ', ')})"
        if found.figure
        else ""
    )
    return f"{run.header.strip}: {found.headline}{figure}"


def verdict_of(
    run: Run, truth: Mapping[str, Any] | None, under_way: bool = False
) -> PageVerdict:
    """Verdict on `run`; `truth`, where it is known, is the plant's motion on the
    twin.
    """
    if under_way:
        return PageVerdict("fair", "Still under way", (_last_seen(run, "so far"),))
    if run.result is None:
        return _verdict_without_result(run)
    if run.result.displacement is None:
        return _without_displacement(run, run.result)
    return _fold_verdict(run, run.result, run.result.displacement, truth or {})


def _fold_verdict(
    run: Run, result: Result, d: float, truth: Mapping[str, Any]
) -> PageVerdict:
    """Verdict on a fold: how the edges lie where that was measured, or else how the
    layers met.
    """
    edge, line = result.edge_offset, run.header.line
    lower = "the lower one" if line is None else "its place"
    sentences = [
        *([] if line is None else [_line_sentence(line)]),
        *_edges_sentences(edge, truth.get("edge_offset"), lower),
        _touch_sentence(result, d, truth.get("displacement")),
    ]
    reasons = (note.reason for note in result.witnesses)
    sentences += [_sentence(reason) for reason in reasons if reason != result.reason]
    agreed = result.agreement
    if agreed is not None and not agreed.like_model and agreed.reason != result.reason:
        sentences.append(_sentence(agreed.reason))
    sentences += [
        _sentence(str(event.facts.get("reason")))
        for event in run.events()
        if event.kind in WARNINGS
    ]
    if result.outcome != "layer_touch":
        sentences.insert(0, _sentence(result.reason))
    return PageVerdict(
        tone=_fold_tone(result, d),
        headline=_fold_headline(result, is_half=line is None),
        sentences=tuple(filter(None, sentences)),
        figure=millimetres(d if edge is None else edge, signed=True),
        error=sigma_lines(run, laid=edge is not None),
    )


def _fold_tone(result: Result, displacement: float) -> Tone:
    """Tone of a fold: good within FOLDED_TOLERANCE, fair beyond it or if doubted, else
    bad.
    """
    if result.outcome in LAID:
        return "fair"
    if result.outcome != "layer_touch":
        return "bad"
    largest = max(abs(displacement), abs(result.edge_offset or 0.0))
    return "good" if largest <= FOLDED_TOLERANCE else "fair"


def _line_sentence(line: float) -> str:
    """Sentence on a fold `line` [m] from the grasped edge."""
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


def _edges_sentences(offset: float | None, true: object, lower: str) -> list[str]:
    """Sentence on how the laid edges lie, as measured and in truth; none where not
    measured.
    """
    if offset is None:
        return []
    words = _edge_words(offset)
    if isinstance(true, int | float):
        lower += f" (true on the twin: {_edge_words(true)})"
    return [f"Laid down, the upper edge lies {words} {lower}."]


def _edge_words(offset: float) -> str:
    """Text of how far [m] the upper edge lies beyond or before the lower one."""
    return f"{millimetres(abs(offset))} {'beyond' if offset > 0 else 'before'}"


def _touch_sentence(result: Result, displacement: float, true: object) -> str:
    """Sentence on how the layers met, as measured and in truth."""
    touched = result.t_layer_touch
    when = "" if touched is None else f" after {seconds(touched)}"
    longer = "longer" if displacement > 0 else "shorter"
    upper = f"the upper one was {longer} by {millimetres(abs(displacement))}"
    return f"Where the layers first touched{when}, {upper}{_true_words(true)}."


def _true_words(true: object) -> str:
    """Text of the `true` length [m] that only the twin knows; empty where it is
    unknown.
    """
    if not isinstance(true, int | float):
        return ""
    return f" (true on the twin: {millimetres(true, signed=True)})"


def _without_displacement(run: Run, result: Result) -> PageVerdict:
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
    return PageVerdict("fair" if done else "bad", outcome_title(result.outcome), said)


def _verdict_without_result(run: Run) -> PageVerdict:
    """Verdict on a run whose result is broken, or whose process died before it wrote
    one.
    """
    if (run.folder / RESULT).exists():
        unread = f"What {RESULT} holds cannot be read."
        sentences = (unread, _last_seen(run, "at the last row"))
        headline = "How the run ended cannot be read"
        return PageVerdict("bad", headline, tuple(filter(None, sentences)), spoilt=True)
    if run.ticks.t.size == 0:
        sentence = "The process died before the arm moved; nothing was measured."
        return PageVerdict("bad", "The process died at the start", (sentence,))
    state = f" in state {run.ticks.state[-1]}" if run.ticks.state else ""
    headline = f"The process died at t = {seconds(run.ticks.t[-1])}{state}"
    return PageVerdict(
        "bad", headline, (_last_seen(run, "then"), "There is no result.")
    )


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
