"""Targets of an exam, tier by tier, and whether each is met; rates with their uncertainty."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from scipy.stats import binomtest

from tests.lab.exam.case import Kind, Tier
from tests.lab.exam.from_state import LEVELS
from tests.lab.exam.ledger import Entry
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
        """Score interval of 95 %, 0 to 1 of no case (Wilson 1927, J. Am. Stat. Assoc. 22, 209)."""
        if not self.count:
            return 0.0, 1.0
        low, high = binomtest(self.hits, self.count).proportion_ci(method="wilson")
        return float(low), float(high)


def rate(found: Iterable[bool]) -> Rate:
    """Rate of the true values in `found`."""
    every = list(found)
    return Rate(sum(every), len(every))


@dataclass(frozen=True, slots=True)
class Bin:
    """Cases of similar stated confidence: their mean confidence, and how many were right."""

    confidence: float
    right: Rate


def reliability(stated: Sequence[tuple[float, bool]], bins: int = 10) -> list[Bin]:
    """Non-empty bins of confidence, of equal width and in rising order (DeGroot, Fienberg 1983)."""
    groups: dict[int, list[tuple[float, bool]]] = {}
    for confidence, right in stated:
        groups.setdefault(min(int(confidence * bins), bins - 1), []).append((confidence, right))
    return [
        Bin(sum(c for c, _ in group) / len(group), rate(right for _, right in group))
        for _, group in sorted(groups.items())
    ]


def brier(stated: Sequence[tuple[float, bool]]) -> float:
    """Mean squared difference of confidence and outcome (Brier 1950, Mon. Weather Rev. 78, 1)."""
    if not stated:
        return float("nan")
    return sum((confidence - right) ** 2 for confidence, right in stated) / len(stated)


def calibration_error(
    stated: Sequence[tuple[float, bool]], bins: int = 10, counts: Iterable[float] | None = None
) -> float:
    """Mean |confidence - rate| of the bins, by weights (n,) (Naeini, Cooper, Hauskrecht 2015)."""
    away, weights = [0.0] * bins, [1.0] * len(stated) if counts is None else list(counts)
    for (confidence, right), weight in zip(stated, weights, strict=True):
        away[min(int(confidence * bins), bins - 1)] += weight * (confidence - right)
    return sum(map(abs, away)) / sum(weights) if stated else float("nan")


@dataclass(frozen=True, slots=True)
class Confusion:
    """Confusion matrix: counts of each hidden cause (rows) by stated name (columns)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: dict[tuple[str, str], int]

    def count(self, row: str, column: str) -> int:
        """Number of cases with `row` hidden for which `column` was stated."""
        return self.counts.get((row, column), 0)


def confusion(found: Iterable[tuple[str, str]]) -> Confusion:
    """Count pairs (hidden cause, stated cause) into a confusion matrix.

    Columns are first the stated ones of the rows, in their order, then all other stated names.
    """
    counts = Counter(found)
    rows = tuple(sorted({hidden for hidden, _ in counts}))
    stated = {column for _, column in counts}
    columns = [row for row in rows if row in stated] + sorted(stated - set(rows))
    return Confusion(rows, tuple(columns), dict(counts))


Judge = Callable[[Rate], bool]
SHRINK_TARGET = 0.9  # of the shrink that knowing the truth would give
ERROR_TARGET = 0.25  # of a parameter
RARE, RARE_END = 0.02, 0.08  # most that the rate of false names and its interval may reach


@dataclass(frozen=True, slots=True)
class Target:
    """Line of the table of targets: quantity, result, target (empty: none), and whether it is met.

    `met` is None with nothing to judge; `few` if so few cases allow not a single failure.
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
        *_false_alarms(entries, through),
        *_names(entries, through),
        *_abstentions(entries, through),
        _coverage(entries, through),
        _shrink(entries, through),
        _errors(entries, through),
        *_cost(entries, through),
    ]


def outcomes(entries: Iterable[Entry], *kinds: Kind) -> list[Outcome]:
    """Outcomes of the cases of these kinds; of all where no kind is given."""
    found = [e.outcome for e in entries if e.outcome is not None]
    return [o for o in found if not kinds or o.kind in kinds]


def rate_text(found: Rate) -> str:
    """Format a rate with its 95 % interval."""
    if not found.count:
        return "no case"
    low, high = found.interval
    return (
        f"{found.hits} of {found.count}, {100 * found.value:.0f} % "
        f"[{100 * low:.0f}, {100 * high:.0f}]"
    )


def _line(
    words: str, found: Rate, wanted: str = "", judge: Judge | None = None, room: float = 0.0
) -> Target:
    """Line for a rate, whose target allows failures in the share `room` of the cases."""
    met = judge(found) if judge is not None and found.count else None
    return Target(words, rate_text(found), wanted, met, met is False and found.count * room < 1.0)


def _false_alarms(entries: Sequence[Entry], through: bool) -> Iterable[Target]:
    """Lines on cases without a hidden effect: no gap, a false name, a claimed gap."""
    nothing = outcomes(entries, "nothing")
    least, most = (0.95, 0.03) if through else (0.97, 0.02)
    quiet = rate(o.result == "correct_no_gap" for o in nothing)
    yield _at_least("`no_gap` where nothing is hidden", quiet, least)
    named = rate(o.result == "false_alarm" for o in nothing)
    words = "an effect named where nothing is hidden"
    if through:
        yield _at_most(words, named, most)
    else:
        yield _line(words, named, "at most 2 %, upper end at most 8 %", _is_rare, RARE)
    claimed = rate(o.claimed for o in nothing)
    yield _line("a gap claimed where nothing is hidden, named or not", claimed)


def _is_rare(found: Rate) -> bool:
    return found.value <= RARE and found.interval[1] <= RARE_END


def _names(entries: Sequence[Entry], through: bool) -> Iterable[Target]:
    """Lines on the names of hidden effects; failed cases count as not right."""
    single = [e for e in entries if e.case.kind == "single"]
    clear = [e for e in single if e.case.strength != "weak"]
    weak = [e for e in single if e.case.strength == "weak"]
    pairs = [e for e in entries if e.case.kind == "pair"]
    strictly, by_class, both = (0.88, 0.93, 0.75) if through else (0.90, 0.96, 0.80)
    rows = [
        ("the right name strictly, medium strength and above", clear, ("right_strict",), strictly),
        ("the right name by its class, medium and above", clear, RIGHT_RESULTS, by_class),
        ("of a pair at least one, and no false one", pairs, (*RIGHT_RESULTS, "partly"), 0.95),
        ("of a pair both", pairs, RIGHT_RESULTS, both),
    ]
    for words, cases, good, least in rows:
        yield _at_least(words, rate(_result(e) in good for e in cases), least)
    foreign = rate(_result(e) in RIGHT_RESULTS for e in clear if e.case.causes)
    if foreign.count:
        yield _at_least("laws that only resemble the library's, by class", foreign, 0.90)
    false = rate(_result(e) == "wrong_name" for e in weak)
    yield _at_most("a wrong name at weak strength", false, 0.05)


def _at_most(words: str, found: Rate, most: float) -> Target:
    return _line(words, found, f"at most {100 * most:.0f} %", lambda r: r.value <= most, most)


def by_group(groups: Sequence[Sequence[Entry]]) -> list[tuple[str, list[str]]]:
    """Table rows of rates: the label of each row, and one rate for each group of entries."""
    rows = [
        ("nothing hidden: `no_gap`", "nothing", (), ("correct_no_gap",)),
        ("nothing hidden: a name", "nothing", (), ("false_alarm",)),
        ("medium and above: by class", "single", ("medium", "strong"), RIGHT_RESULTS),
        ("medium and above: strictly", "single", ("medium", "strong"), ("right_strict",)),
        ("weak: a wrong name", "single", ("weak",), ("wrong_name",)),
        ("pairs: both", "pair", (), RIGHT_RESULTS),
        ("outside the library: left open", "outside", (), ("correct_abstention",)),
    ]
    lines = [
        (words, [_group_rate(group, kind, strengths, good) for group in groups])
        for words, kind, strengths, good in rows
    ]
    held = [rate_text(rate(c.covered for c in comparisons(group))) for group in groups]
    return [*lines, ("intervals that hold the truth", held)]


def _group_rate(
    group: Iterable[Entry], kind: str, strengths: Sequence[str], good: Sequence[str]
) -> str:
    """Rate of `good` results among entries of `kind`, of these `strengths` or of all."""
    mine = [e for e in group if e.case.kind == kind]
    mine = [e for e in mine if not strengths or e.case.strength in strengths]
    return rate_text(rate(_result(e) in good for e in mine))


def spread_errors(entries: Iterable[Entry]) -> dict[str, list[float]]:
    """Estimated over true run-to-run spreads at full scatter, by quantity; 0 if not found."""
    full = LEVELS["full"]
    truth = {"grip_x": full.grip, "grip_z": full.grip, "damping": full.damping,
             "stiffness": full.stiffness}  # fmt: skip
    mine = [e for e in entries if e.case.scatter == "full" and e.outcome is not None]
    return {name: [e.spreads.get(name, 0.0) / true for e in mine] for name, true in truth.items()}


def _at_least(words: str, found: Rate, least: float | None) -> Target:
    if least is None:
        return _line(words, found)
    wanted = f"at least {100 * least:.0f} %"
    return _line(words, found, wanted, lambda r: r.value >= least, 1.0 - least)


def _result(entry: Entry) -> str:
    return entry.outcome.result if entry.outcome is not None else "failed"


def _abstentions(entries: Sequence[Entry], through: bool) -> Iterable[Target]:
    outside = [e for e in entries if e.case.kind == "outside"]
    if outside or through:
        found = rate(_result(e) == "correct_abstention" for e in outside)
        yield _at_least("abstained on causes outside the library", found, 0.95 if through else None)


def comparisons(entries: Iterable[Entry]) -> list[Comparison]:
    """Comparisons of all parameters whose true values are known."""
    return [c for o in outcomes(entries) for c in (*o.base, *o.parameters)]


def _coverage(entries: Sequence[Entry], through: bool) -> Target:
    found = rate(c.covered for c in comparisons(entries))
    words = "95 % intervals that hold the truth, where the laws agree"
    least = 0.90 if through else 0.92
    wanted = f"{100 * least:.0f} to 98 %"
    return _line(words, found, wanted, lambda r: least <= r.value <= 0.98, 0.02)


def shares(entries: Iterable[Entry]) -> list[float]:
    """Share of the gap removed by named effects, over that with the truth known, for each case."""
    return [
        e.outcome.shrink / e.oracle.shrink
        for e in entries
        if e.outcome and e.oracle and e.outcome.verdict == "named" and e.oracle.shrink > 0.0
    ]


def _shrink(entries: Sequence[Entry], through: bool) -> Target:
    found = shares(entries)
    words = "held-out gap shrunk, over what knowing the truth would give (median of named)"
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
    walls = [e.wall for e in entries if e.outcome is not None]
    memory = [e.memory for e in entries if e.outcome is not None]
    if not walls:
        return
    middle, longest = median(walls), max(walls)
    usual, most = (25.0, 120.0) if through else (15.0, 60.0)
    for words, found, wanted in (("median", middle, usual), ("longest", longest, most)):
        line = f"run time on one core, {words}"
        yield Target(line, f"{found:.0f} s", f"{wanted:.0f} s", found <= wanted)
    yield Target("peak memory, largest", f"{max(memory):.0f} MB", "1024 MB", max(memory) < 1024.0)
