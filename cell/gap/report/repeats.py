"""How much runs differ for no reason, in words for those who can change it."""

from collections.abc import Iterator, Mapping

from cell.gap.fitting.spreads import Spread
from cell.gap.report.units import number
from cell.gap.subject.strip.scatter import RUN_EFFECTS
from cell.gap.verdict.findings import Findings
from cell.report.markup import table

WORSE = 0.8  # of the usual spread, from which a remedy is worth more than another motion
SHOWN = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "s": (1e3, "ms"), "1": (100.0, "%")}


def repeats(found: Findings) -> str:
    """Spread of each quantity that differs from run to run, with its remedy, as HTML."""
    if not any(p.random for run in found.subject.runs for p in run.local):
        return ""
    scatter = found.judged.scatter
    if not scatter:
        return "<p>Runs differ by no more than the noise of what is measured.</p>"
    note = (
        "<p class='note'>One standard deviation from run to run, with its 95 % interval, estimated "
        "from these runs beside the accepted model. Names, intervals and what is detectable count "
        "it.</p>"
    )
    return note + table(("what differs", "by", "95 %", "smaller by"), list(_rows(found)))


def remedies(spreads: Mapping[str, tuple[float, str]]) -> Iterator[str]:
    """A line for each quantity that differs by more than usual: by how much, what would help.

    `spreads` are standard deviations with their units, by name. Where a laboratory does worse
    than an honest one usually does, a better grip or more repeats tell more than another motion.
    """
    known = {e.name: e for e in RUN_EFFECTS}
    for name, (value, unit) in spreads.items():
        effect = known.get(name)
        if effect is None:
            continue
        factor, shown = SHOWN.get(unit, (1.0, unit))
        line = f"{effect.sentence} differs by {number(factor * value, 2)} {shown} from run to run"
        if value > WORSE * effect.usual:
            yield f"{line}: before another motion, {effect.remedy}; or repeat each motion twice"
        else:
            yield f"{line}, as usual"


def _rows(found: Findings) -> Iterator[tuple[str, str, str, str]]:
    known = {e.name: e for e in found.subject.scope.scatter}
    for s in found.judged.scatter:
        factor, unit = SHOWN.get(s.unit, (1.0, s.unit))
        ends = f"{number(factor * s.low, 2)} to {number(factor * s.high, 2)}"
        said, remedy = known[s.name].sentence, known[s.name].remedy
        yield said, spread(s), f"{ends} {unit}", remedy


def spread(s: Spread) -> str:
    """A spread with its unit, as a person reads it."""
    factor, unit = SHOWN.get(s.unit, (1.0, s.unit))
    return f"{number(factor * s.value, 2)} {unit}"
