"""Study of the confidence that `cell gap` states, and its calibration: verdicts against
the truth.

Cases from the state hide one effect, one in eight two. From two in five the effect is
withheld from the library, with what looks like it: whatever is named is wrong.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy import optimize, special

from cell.gap.rehearse import table
from cell.gap.verdict.confidence import LogOddsCalibration, calibration
from cell.gap.verdict.schema import VerdictEvidence
from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.strip.effects import registry
from tests.lab.exam.case import Case
from tests.lab.exam.cases import draw_case
from tests.lab.exam.from_state import make_runs
from tests.lab.exam.run import judge
from tests.lab.studies.study import (
    Fit,
    Outcome,
    Quantity,
    Statistic,
    Study,
    Values,
    figure,
    percentage,
)

PAIRS = 8  # one case in so many hides two
LACKING = (1, 3)  # of five cases, those that lack the effect
# prior weights of the signs; the values between which they count stand in the shipped
# calibration
PRIORS = read_yaml(Path(__file__).with_suffix(".yaml"))
FIRM = 2.0  # one sigma of what a sign weighs about that, in log-odds


Claims = Sequence[tuple[float, bool]]
"""Stated probabilities, each with whether the verdict is right."""
# of the causes that a confidence speaks of: as in the exam through images
OUTSIDE_SHARE = 0.2
FIFTHS, DOUBTFUL = 5, 0.7  # bins; confidence under which a wrong name does little harm
RIGHT = percentage("right")


class Name(NamedTuple):
    """Accepted effects of a verdict: evidence, whether right, whether the cause is
    outside.
    """

    signs: VerdictEvidence
    right: bool
    outside: bool
    case: str


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw the kind of a case: one effect or two, in the library or withheld from
    it.
    """
    kind, of_kind = (
        ("pair", number // PAIRS) if number % PAIRS == PAIRS - 1 else ("single", number)
    )
    lacks = number % 5 in LACKING
    return {
        "kind": kind,
        "of_kind": of_kind,
        "seed": int(rng.integers(2**31)),
        "library": "lacks the effect" if lacks else "whole",
    }


def measure(case: Values) -> Values:
    """Score of the verdict on a case, as of the exam's."""
    hidden = draw_case("state", case["kind"], case["of_kind"], case["seed"])
    without = names_to_withhold(hidden) if case["library"] != "whole" else []
    with TemporaryDirectory() as place:
        make_runs(hidden, Path(place) / "runs")
        judged = judge(hidden, Path(place), without)
    said = judged["outcome"] or {"verdict": "failed", "confidence": None}
    named = said["verdict"] == "named"
    right = judged["claim"]["right"] if named else None
    facts = {"is_named": named, "is_right": right, "confidence": said["confidence"]}
    return {**judged, **facts, "without": without}


def names_to_withhold(case: Case) -> list[str]:
    """Names removed from the library: the hidden or resembled effect, and its twins."""
    hidden = sorted(case.effects or case.answer)[0]
    return sorted({hidden, *registry()[hidden].looks_like})


def names(claims: Sequence[Values]) -> tuple[list[Name], float]:
    """What verdicts accept, named, in a class or suspected, by their `claims`, and the
    share of the causes that the library lacks.
    """
    found = [
        Name(VerdictEvidence(**c["signs"]), c["right"], c["outside"], c["case"])
        for c in claims
        if c["signs"] and c["right"] is not None
    ]
    causes = [c["outside"] for c in claims if c["hides"]]
    return found, sum(causes) / max(len(causes), 1)


def shares(found: Sequence[Name], outside: float) -> Array:
    """Weights (n,) of verdicts that give causes outside the library the
    OUTSIDE_SHARE.
    """
    lacking = OUTSIDE_SHARE / outside if outside else 1.0
    whole = (1.0 - OUTSIDE_SHARE) / (1.0 - outside or 1.0)  # all of them may be outside
    return np.array([lacking if name.outside else whole for name in found])


def fit_calibration(
    found: Sequence[Name], counts: Array, kind: str
) -> LogOddsCalibration:
    """Fit the weights of the signs of a `kind` of subject to verdicts with weights
    `counts` (n,).
    """
    known = calibration(kind)
    intercept, *weights = map(float, _weigh(*_columns(found, known), counts, known))
    pairs = zip(known.weights.items(), weights, strict=True)
    fitted = {n: w.model_copy(update={"weight": value}) for (n, w), value in pairs}
    return known.model_copy(update={"intercept": intercept, "weights": fitted})


def _columns(found: Sequence[Name], known: LogOddsCalibration) -> tuple[Array, Array]:
    """Shares (n, k) of the signs of verdicts, a column of ones first, and whether each
    is right (n,).
    """
    rows = [
        [1.0, *(w.share(getattr(n.signs, s)) for s, w in known.weights.items())]
        for n in found
    ]
    right = np.array([name.right for name in found], dtype=float)
    return np.reshape(rows, (len(found), 1 + len(known.weights))), right


def _weigh(
    columns: Array, right: Array, counts: Array, known: LogOddsCalibration
) -> Array:
    """Intercept and weights (k,) of the columns (n, k) by which verdicts are `right`.

    Logistic regression with normal priors of what each sign weighs, for few verdicts
    are wrong; no sign speaks against its sense.
    """
    prior = np.array([PRIORS[sign] for sign in known.weights])

    def loss(x: Array) -> tuple[float, Array]:
        odds, away = columns @ x, (x[1:] - prior) / FIRM
        nats = counts @ (np.logaddexp(0.0, odds) - right * odds)
        slope = columns.T @ (counts * (special.expit(odds) - right))
        slope[1:] += away / FIRM
        return float(nats + 0.5 * away @ away), slope

    bounds = [(0.0, None) if w > 0.0 else (None, 0.0) for w in prior]
    start, free = np.concatenate([[0.0], prior]), [(None, None), *bounds]
    best = optimize.minimize(loss, start, jac=True, method="L-BFGS-B", bounds=free)
    return np.asarray(best.x)


def leave_each_out(
    found: Sequence[Name], counts: Array, kind: str
) -> list[tuple[float, bool]]:
    """Confidence in each verdict, fitted to other cases of weights (n,), and if it is
    right.
    """
    known = calibration(kind)
    columns, right = _columns(found, known)
    cases = np.array([name.case for name in found])
    stated = []
    for row, name in zip(columns, found, strict=True):
        kept = cases != name.case
        weights = _weigh(columns[kept], right[kept], counts[kept], known)
        stated.append((float(special.expit(row @ weights)), name.right))
    return stated


def log_loss(stated: Claims, counts: Array | None = None) -> float:
    """Mean logarithmic loss [nats] of these probabilities and outcomes, with weights
    (n,).
    """
    p = np.array([p if right else 1.0 - p for p, right in stated])
    return float(-np.average(np.log(np.clip(p, 1e-9, 1.0)), weights=counts))


def reliable(stated: Claims, counts: Array | None = None) -> str:
    """Reliability of stated probabilities in fifths, as a Markdown table (DeGroot,
    Fienberg 1983).

    With weights `counts` (n,) of verdicts also its errors where OUTSIDE_SHARE of the
    causes lie outside the library, for which the probability is stated.
    """
    said, right = np.reshape(stated, (-1, 2)).T
    fifths = np.minimum((said * FIFTHS).astype(int), FIFTHS - 1)
    rows = []
    for fifth in np.unique(fifths):
        here = fifths == fifth
        mean, earned = said[here].mean(), figure(RIGHT, right[here][:, None])
        apart = f"{earned.value - 100 * mean:+.0f}"
        rows.append((f"{mean:.2f}", f"{earned.text()} of {here.sum()}", apart))

    head = ["mean stated probability, by fifths", "right, by class [%]", "points apart"]
    wrong = said[right == 0.0]
    text = (
        f"{table(head, rows)}\n\n{len(stated)} verdicts that accept, {len(wrong)} of"
        f" them wrong, {np.sum(wrong < DOUBTFUL)} of these stated under {DOUBTFUL};"
    )
    weighed = {"": np.ones(len(stated))}
    if counts is not None:
        weighed[f" with {OUTSIDE_SHARE:.0%} of causes outside"] = counts
    for words, by in weighed.items():
        # mean |confidence - rate| of the bins (Naeini, Cooper, Hauskrecht 2015)
        away = np.bincount(fifths, by * (said - right))
        text += (
            f" expected calibration error{words}"
            f" {np.abs(away).sum() / by.sum():.3f}, log loss"
            f" {log_loss(stated, by):.3f} nats."
        )
    return text


def calibrate(claims: Sequence[Values], kind: str = "strip") -> Values:
    """Fit a `kind`'s calibration to these verdicts; its source says the loss on those
    left out.
    """
    found, outside = names(claims)
    counts = shares(found, outside)
    source = (
        f"{len(found)} verdicts that accept, {sum(not n.right for n in found)} of them"
        f" wrong, {sum(n.outside for n in found)} of a cause that the library lacks,"
        f" counted as if {100 * OUTSIDE_SHARE:.0f} % of all causes were such."
    )
    if found:
        stated = leave_each_out(found, counts, kind)
        rate = float(np.average([name.right for name in found], weights=counts))
        plain = log_loss([(rate, name.right) for name in found], counts)
        source += (
            f" Left out one by one, log loss {log_loss(stated, counts):.3f} nats, "
        )
        source += f"of one probability for all {plain:.3f}."
    return {**fit_calibration(found, counts, kind).model_dump(), "source": source}


def fit_claims(outcomes: Sequence[Outcome]) -> Values:
    """Calibration of strips by the verdicts of the study."""
    return calibrate([o.values["claim"] for o in outcomes])


STUDY = Study(
    name="confidence",
    question=(
        "Is what `cell gap` names right as often as it states, in and out of its"
        " library?"
    ),
    draw=draw,
    measure=measure,
    by=("library",),
    quantities=(
        percentage("is_named", "named"),
        percentage("is_right", "right of these"),
        Quantity("confidence", Statistic.MEAN, "%", 100.0, label="stated", digits=0),
    ),
    fits=(Fit("cell/gap/verdict/confidence.yaml", fit_claims),),
    usual=60,
    quick=1,
    seconds=60.0,
)
