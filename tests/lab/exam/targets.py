"""Targets of an exam, tier by tier, and whether each is met; rates with their
uncertainty.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from scipy.stats import binomtest

from cell.gap.rehearse import table
from drivers.base.types import Array
from tests.lab.exam.case import Tier
from tests.lab.exam.run import Entry
from tests.lab.exam.score import RIGHT_RESULTS, Comparison, Outcome


@dataclass(frozen=True, slots=True)
class Rate:
    """A rate: `hits` of `count` cases."""

    hits: int
    count: int

    @property
    def value(self) -> float:
        """Share of hits; NaN without cases."""
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Score interval of 95 %, 0 to 1 of no case (Wilson 1927, J. Am. Stat. Assoc.
        22, 209).
        """
        if not self.count:
            return 0.0, 1.0
        low, high = binomtest(self.hits, self.count).proportion_ci(method="wilson")
        return float(low), float(high)


def rate(found: Iterable[bool]) -> Rate:
    """Rate of the true values in `found`."""
    every = list(found)
    return Rate(sum(every), len(every))


Claims = Sequence[tuple[float, bool]]
"""Stated probabilities, each with whether the verdict is right."""


# of the causes that a confidence speaks of: as in the exam through images
OUTSIDE_SHARE = 0.2
FIFTHS, DOUBTFUL = 5, 0.7  # bins; confidence under which a wrong name does little harm


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
        mean, earned = float(said[here].mean()), rate(right[here] > 0.0)
        apart = f"{100 * (earned.value - mean):+.0f}"
        rows.append((f"{mean:.2f}", rate_text(earned), apart))

    head = ["mean stated probability, by fifths", "right, by class", "points apart"]
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


SHRINK_TARGET = 0.9  # of the shrink that knowing the truth would give
ERROR_TARGET = 0.25  # of a parameter
RARE_END = 0.08  # most that the interval of a rare rate may reach


@dataclass(frozen=True, slots=True)
class Target:
    """Line of the table of targets: quantity, result, target, and whether it is met.

    `met` is None with nothing to judge; `few` if so few cases allow not a single
    failure.
    """

    words: str
    found: str
    wanted: str = ""
    met: bool | None = None
    few: bool = False


def targets(entries: Sequence[Entry], tier: Tier) -> list[Target]:
    """Lines of the table of targets for a tier."""
    through = tier == "images"
    return [
        *_rates(entries, through),
        _coverage(entries, through),
        _shrink(entries, through),
        _errors(entries, through),
        *_cost(entries, through),
    ]


def outcomes(entries: Iterable[Entry]) -> list[Outcome]:
    """Outcomes of the cases that have one."""
    return [e.outcome for e in entries if e.outcome is not None]


def rate_text(found: Rate) -> str:
    """Format a rate with its 95 % interval."""
    if not found.count:
        return "no case"
    low, high = found.interval
    return (
        f"{found.hits} of {found.count}, {100 * found.value:.0f} % "
        f"[{100 * low:.0f}, {100 * high:.0f}]"
    )


CLEAR, WEAK = ("medium", "strong"), ("weak",)
Bars = tuple[float | None, float | None]  # from the state, through images
RATES: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...], str, Bars], ...] = (
    (
        "`no_gap` where nothing is hidden",
        "nothing",
        (),
        ("correct_no_gap",),
        "least",
        (0.97, 0.95),
    ),
    (
        "an effect named where nothing is hidden",
        "nothing",
        (),
        ("false_alarm",),
        "most",
        (0.02, 0.03),
    ),
    (
        "a gap claimed where nothing is hidden, named or not",
        "nothing",
        (),
        ("false_alarm", "gap_claimed"),
        "most",
        (None, None),
    ),
    (
        "the right name strictly, medium strength and above",
        "single",
        CLEAR,
        ("right_strict",),
        "least",
        (0.90, 0.88),
    ),
    (
        "the right name by its class, medium and above",
        "single",
        CLEAR,
        RIGHT_RESULTS,
        "least",
        (0.96, 0.93),
    ),
    (
        "of a pair at least one, and no false one",
        "pair",
        (),
        (*RIGHT_RESULTS, "partly"),
        "least",
        (0.95, 0.95),
    ),
    ("of a pair both", "pair", (), RIGHT_RESULTS, "least", (0.80, 0.75)),
    (
        "laws that only resemble the library's, by class",
        "another law",
        CLEAR,
        RIGHT_RESULTS,
        "least",
        (0.90, 0.90),
    ),
    (
        "a wrong name at weak strength",
        "single",
        WEAK,
        ("wrong_name",),
        "most",
        (0.05, 0.05),
    ),
    (
        "abstained on causes outside the library",
        "outside",
        (),
        ("correct_abstention",),
        "least",
        (None, 0.95),
    ),
)
"""Rates by their words: kind and strengths of cases, good results, the least or most
wanted.

Cases without a verdict count as not right, but say nothing of false alarms.
"""


def _rates(entries: Sequence[Entry], through: bool) -> Iterable[Target]:
    for words, kind, strengths, good, sense, bars in RATES:
        cases, bar = _chosen(entries, kind, strengths), bars[through]
        if kind == "nothing":
            cases = [e for e in cases if e.outcome is not None]
        if not cases and (kind == "another law" or (kind == "outside" and not through)):
            continue
        found = rate(_result(e) in good for e in cases)
        if bar is None:
            yield Target(words, rate_text(found))
            continue
        met = found.value >= bar if sense == "least" else found.value <= bar
        wanted, room = (
            f"at {sense} {100 * bar:.0f} %",
            1.0 - bar if sense == "least" else bar,
        )
        if good == ("false_alarm",) and not through:
            wanted += f", upper end at most {100 * RARE_END:.0f} %"
            met = met and found.interval[1] <= RARE_END
        few = not met and found.count * room < 1.0
        yield Target(
            words, rate_text(found), wanted, met if cases else None, bool(cases) and few
        )


def by_group(groups: Sequence[Sequence[Entry]]) -> list[tuple[str, list[str]]]:
    """Table rows of rates: the label of each row, and one rate for each group of
    entries.
    """
    lines = [
        (
            words,
            [
                rate_text(
                    rate(_result(e) in good for e in _chosen(group, kind, strengths))
                )
                for group in groups
            ],
        )
        for words, kind, strengths, good, *_ in RATES
        if kind != "another law"
    ]
    held = [rate_text(rate(c.covered for c in comparisons(group))) for group in groups]
    return [*lines, ("intervals that hold the truth", held)]


def _chosen(
    entries: Iterable[Entry], kind: str, strengths: Sequence[str]
) -> list[Entry]:
    """Entries of a kind of case or plant, and of these `strengths` if any are given."""
    mine = [e for e in entries if kind in (e.case.kind, e.case.plant)]
    return [e for e in mine if not strengths or e.case.strength in strengths]


def _result(entry: Entry) -> str:
    return entry.outcome.result if entry.outcome is not None else "failed"


def comparisons(entries: Iterable[Entry]) -> list[Comparison]:
    """Comparisons of all parameters whose true values are known."""
    return [c for o in outcomes(entries) for c in (*o.base, *o.parameters)]


def _coverage(entries: Sequence[Entry], through: bool) -> Target:
    found = rate(c.covered for c in comparisons(entries))
    words = "95 % intervals that hold the truth, where the laws agree"
    least = 0.90 if through else 0.92
    met = least <= found.value <= 0.98 if found.count else None
    few = met is False and found.count * 0.02 < 1.0
    return Target(words, rate_text(found), f"{100 * least:.0f} to 98 %", met, few)


def shares(entries: Iterable[Entry]) -> list[float]:
    """Share of the gap removed by named effects, over that with the truth known, for
    each case.
    """
    return [
        e.outcome.shrink / e.oracle.shrink
        for e in entries
        if e.outcome
        and e.oracle
        and e.outcome.verdict == "named"
        and e.oracle.shrink > 0.0
    ]


def _shrink(entries: Sequence[Entry], through: bool) -> Target:
    found = shares(entries)
    words = (
        "held-out gap shrunk, over what knowing the truth would give (median of named)"
    )
    wanted = f"at least {100 * SHRINK_TARGET:.0f} %" if through else ""
    return _median(words, found, wanted, lambda v: v >= SHRINK_TARGET)


def _errors(entries: Sequence[Entry], through: bool) -> Target:
    found = [c.error for c in comparisons(entries) if c.switch and c.error is not None]
    words = "relative error of the amount of an effect, where the laws agree (median)"
    wanted = f"within {100 * ERROR_TARGET:.0f} %" if through else ""
    return _median(words, found, wanted, lambda v: v <= ERROR_TARGET)


def _median(
    words: str, found: Sequence[float], wanted: str, judge: Callable[[float], bool]
) -> Target:
    if not found:
        return Target(words, "no case", wanted)
    middle = median(found)
    met = judge(middle) if wanted else None
    return Target(words, f"{100 * middle:.0f} % of {len(found)} values", wanted, met)


def _cost(entries: Sequence[Entry], through: bool) -> Iterable[Target]:
    times = [o.runtime for o in outcomes(entries)]
    usual, most = (25.0, 120.0) if through else (15.0, 60.0)
    for words, of, wanted in (("median", median, usual), ("longest", max, most)):
        line = f"run time on one core, {words}"
        found = of(times) if times else 0.0
        yield Target(line, f"{found:.0f} s", f"{wanted:.0f} s", found <= wanted)
