"""Text on run-to-run spreads, for those who can reduce them."""

from collections.abc import Iterator, Mapping

from cell.gap.fitting.spreads import Spread
from cell.gap.report.units import number
from cell.gap.subject.strip.scatter import KNOWN_EFFECTS
from cell.gap.verdict.findings import Findings

SMALLEST_GAIN = 1.0  # sigma that a smaller spread must add to be worth a word
SHOWN_UNITS = {
    "m": (1e3, "mm"),
    "rad": (1e3, "mrad"),
    "s": (1e3, "ms"),
    "1": (100.0, "%"),
    "N": (1e3, "mN"),
}


def repeats(found: Findings) -> list[tuple[str, ...]] | None:
    """Rows on each quantity that differs from run to run, with its remedy; None if unknown."""
    if not any(p.random for run in found.subject.runs for p in run.local):
        return None
    return list(_rows(found))


def remedies(
    spreads: Mapping[str, tuple[float, str]], steadier: Mapping[str, float], planned: float
) -> Iterator[str]:
    """Lines on each run-to-run spread, and whether halving it would help more than a new motion.

    `spreads` are standard deviations with their units; with half of one, the runs would separate
    two explanations by `steadier` [sigma] more, by name; the best motion separates by `planned`.
    """
    known = {e.name: e for e in KNOWN_EFFECTS}
    for name, (value, unit) in spreads.items():
        effect = known.get(name)
        if effect is None:
            continue
        factor, shown = SHOWN_UNITS.get(unit, (1.0, unit))
        line = f"{effect.sentence} differs by {number(factor * value, 2)} {shown} from run to run"
        more = steadier.get(name, 0.0)
        if more < SMALLEST_GAIN:
            yield f"{line}: half of it would show nothing more"
        else:
            than = "more" if more > planned else "less"
            yield (
                f"{line}: half of it would show {more:.1f} sigma more, {than} than any motion "
                f"({planned:.1f}): {effect.remedy}, or each motion made four times"
            )


def _rows(found: Findings) -> Iterator[tuple[str, ...]]:
    """Sentence, spread, its interval, gain if halved, and remedy of each quantity."""
    known = {e.name: e for e in found.subject.scope.scatter}
    more = {s.name: f"{s.sigma:.1f} sigma more" for s in found.advised.steadier}
    for s in found.judged.scatter:
        factor, unit = SHOWN_UNITS.get(s.unit, (1.0, s.unit))
        ends = f"{number(factor * s.low, 2)} to {number(factor * s.high, 2)}"
        sentence, remedy = known[s.name].sentence, known[s.name].remedy
        yield sentence, spread(s), f"{ends} {unit}", more.get(s.name, ""), remedy


def spread(s: Spread) -> str:
    """Text of a spread with its unit, as pages show it."""
    factor, unit = SHOWN_UNITS.get(s.unit, (1.0, s.unit))
    return f"{number(factor * s.value, 2)} {unit}"
