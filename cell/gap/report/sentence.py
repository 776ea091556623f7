"""Sentences, numbers and units of a fit's verdict, for a technician."""

from collections.abc import Iterable, Iterator, Sequence

from cell.gap.fitting.reml import Spread
from cell.gap.subject.strip.measurement_errors import KNOWN_EFFECTS
from cell.gap.subject.subject import Quantity, ScatterSource
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Deviation, Interval, NamedEffect, Verdict
from cell.report.words import PARAMETERS, plain
from drivers.base.errors import in_percent

POWERS = {"^2": "²", "^3": "³", "^4": "⁴"}
SMALL_UNITS = {
    "m": (1e3, "mm"),
    "rad": (1e3, "mrad"),
    "s": (1e3, "ms"),
    "kg": (1e3, "g"),
}
"""Units shown in thousandths, so that a page has one unit for each kind of quantity."""
TITLES = {
    "ambiguous": "Something is missing, and these runs cannot tell what",
    "no_gap": "No gap",
    "unexplained": "Something is missing that the library does not explain",
}
SPREAD_UNITS = {**SMALL_UNITS, "1": (100.0, "%"), "N": (1e3, "mN")}


def in_small_unit(value: float, of: str) -> float:
    """Number for `value`, which is stated in the unit `of`, in the smaller unit that
    pages show, such as mm for m.
    """
    return value * SMALL_UNITS.get(of, (1.0, of))[0]


def shown_unit(text: str) -> str:
    """Symbol of the unit in which pages show quantities stated in the unit `text`, such
    as mm for m and ms for s; empty for the unit 1.
    """
    text = SMALL_UNITS.get(text, (1.0, text))[1]
    for power, raised in POWERS.items():
        text = text.replace(power, raised)
    return "" if text == "1" else text.replace(" ", "\N{NO-BREAK SPACE}")


def number_text(value: float, digits: int = 3) -> str:
    """Text of the number `value` with `digits` significant digits, in which a power of
    ten is written as a superscript.
    """
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{raised}"


def probability_text(p: float) -> str:
    """Text of the probability `p` with two significant digits, or `< 10⁻⁹` where it is
    below one in a billion.
    """
    return "< 10⁻⁹" if p < 1e-9 else number_text(p, 2)


def _quantity_text(value: float, of: str) -> str:
    """Text of `value`, which is stated in the unit `of`, with number and symbol of the
    unit that pages show.
    """
    text = f"{number_text(in_small_unit(value, of))}\N{NO-BREAK SPACE}{shown_unit(of)}"
    return text.rstrip("\N{NO-BREAK SPACE}")


def interval_numbers(value: Interval, of: str, digits: int = 3) -> list[str]:
    """Texts of an estimate and, where both are known, of the ends of its interval, in
    the unit that pages show for the unit `of`.
    """
    ends = () if None in (value.low, value.high) else (value.low, value.high)
    return [number_text(in_small_unit(v, of), digits) for v in (value.value, *ends)]


def interval_text(value: Interval) -> str:
    """Text of an estimated value with its 95 % interval, if that is bounded, in the
    unit that pages show.
    """
    unit = value.unit
    middle, *ends = interval_numbers(value, unit)
    if not ends:
        return _quantity_text(value.value, unit)
    return f"{middle} [{', '.join(ends)}] {shown_unit(unit)}".rstrip()


def headline(verdict: Verdict) -> str:
    """Headline of a verdict: values of the file that do not hold, then the missing
    effects with a size that surely differs from zero.
    """
    parts = []
    if verdict.deviates:
        names = ", ".join(plain(d.parameter) for d in verdict.deviates)
        parts.append(f"Not as the file states: {names}")

    for effect in verdict.effects if verdict.verdict == "named" else ():
        sizes = effect.parameters
        first, *_ = sizes
        unit = sizes[first].unit  # of all joints
        sure = [n for n, v in sizes.items() if v.unit == unit and _is_sure(v)]
        name, *_ = [*sure, first]
        parts.append(
            f"{effect_title(effect)}: {plain(name)} {interval_text(sizes[name])}"
        )

    parts += filter(None, [TITLES.get(verdict.verdict)])
    return "; ".join(parts)


def effect_title(effect: NamedEffect) -> str:
    """Name of an `effect` for people, in words; for some effects it is given by their
    first parameter.
    """
    return str(PARAMETERS.get(next(iter(effect.parameters)), plain(effect.name)))


def _is_sure(value: Interval) -> bool:
    """Whether both ends of the interval are known and lie on the same side of zero."""
    return (value.low or 0.0) * (value.high or 0.0) > 0.0


def sentence(findings: Findings, verdict: Verdict) -> str:
    """Sentence that tells a technician what is missing in the model, and how sure that
    is.
    """
    words = {
        "named": _name_effects,
        "ambiguous": _ambiguity,
        "no_gap": _no_gap,
        "unexplained": _describe_rest,
    }
    return words[verdict.verdict](findings, verdict)


def _name_effects(findings: Findings, verdict: Verdict) -> str:
    """Sentence on the effects that the verdict names, with their sizes and with doubts
    about them.
    """
    known = findings.scope.by_name
    effects = ", and ".join(
        f"{known[effect.name].sentence} ({effect.name}:"
        f" {_parameter_values(effect.parameters)}"
        + (
            f"; {in_percent(effect.confidence)} probable)"
            if verdict.effects[1:]
            else ")"
        )
        for effect in verdict.effects
    )
    text = f"{effects}."
    if alike := verdict.ambiguous:
        either = "; ".join(" or ".join(group) for group in alike)
        text += (
            " Beside it something is missing that these runs cannot tell apart:"
            f" {either}"
        )
        shown = findings.accepted.names - {e.name for e in findings.separable}
        text += f" (the numbers are with {' and '.join(sorted(shown))})."

    return capitalised(text)


def _ambiguity(findings: Findings, verdict: Verdict) -> str:
    """Sentence on effects that the runs cannot tell apart, and on the experiment that
    would do so.
    """
    sentences = {
        candidate.name: f"{candidate.sentence} ({candidate.name})"
        for candidate in findings.scope.candidates
    }
    sentences |= {
        p.name: f"the file is wrong about {p.name}" for p in findings.scope.base
    }
    groups = [
        [sentences.get(name, name) for name in group] for group in verdict.ambiguous
    ]
    either = "; ".join(", or ".join(group) for group in groups)
    split = "No planned experiment would split them"
    if verdict.advice:
        split = f"The experiment that would split them: {verdict.advice[0].experiment}"
    return f"Something is missing that these runs cannot tell apart: {either}. {split}."


def _no_gap(findings: Findings, verdict: Verdict) -> str:
    """Sentence that the model explains the runs, with the number of effects that would
    show at sizes that they usually have.
    """
    limits = verdict.detectable
    known = findings.scope.by_name
    usual = [n for n, limit in limits.items() if known[n].is_usual(limit)]
    return (
        f"The model explains the fitted runs down to their noise. {len(usual)} effects"
        " would have shown below their usual size, from the sizes listed below on."
    )


def _describe_rest(findings: Findings, verdict: Verdict) -> str:
    """Sentence on residuals that no effect of the library explains."""
    rest = verdict.unexplained
    description = rest.description if rest else ""
    accepted = findings.accepted
    part = accepted.effects and not accepted.proxies
    tried = f"; {accepted.model.name} explains a part but not all of it" if part else ""
    return capitalised(
        f"{description}: no effect of the library accounts for it{tried}."
    )


def deviation_text(deviates: Sequence[Deviation]) -> str:
    """Text on the fitted values that differ from what the file of the strip or
    mechanism states and tolerates.
    """
    parts = []
    for d in deviates:
        stated, *ends = (
            "any" if value is None else _quantity_text(value, d.unit)
            for value in (d.stated, *d.tolerated)
        )
        parts.append(
            f"{plain(d.parameter)} {interval_text(d)}, the file states {stated} and"
            f" tolerates {' to '.join(ends)}"
        )
    return f"not as the file states: {'; '.join(parts)}"


def _parameter_values(parameters: dict[str, Interval]) -> str:
    return ", ".join(
        f"{plain(name)} {_quantity_text(v.value, v.unit)}"
        for name, v in parameters.items()
    )


def undetectable_effects(findings: Findings) -> list[str]:
    """Names of the effects that these runs would not show at any possible size."""
    limits = findings.screen.detectable | {
        effect.name: 0.0 for effect in findings.accepted.effects
    }
    return sorted(name for name, size in limits.items() if size is None)


def usual_size(findings: Findings, name: str) -> str:
    """Text of the largest size that the effect `name` usually has; empty where that is
    not known.
    """
    candidate = findings.scope.by_name[name]
    first = candidate.parameters[0]
    usual = candidate.usual
    if usual is None:
        return ""
    return detection_limit(findings, name, first.stated_value(first.start + usual))


def detection_limit(findings: Findings, name: str, value: float) -> str:
    """Text of the smallest size `value` of the effect `name` that runs would show;
    where infinity means no effect, it is the largest such value.
    """
    first = findings.scope.by_name[name].parameters[0]
    unit = first.unit
    label = f"{first.name} " if unit == "1" else ""
    bound = "at most " if first.inverse else ""
    return f"{label}{bound}{_quantity_text(abs(value), unit)}"


def quantity_label(of: Quantity) -> str:
    """Name in words of a measured quantity, such as `contact x`, derived
    from its key.
    """
    words = plain(of.key.rsplit("_", 1)[0])
    return f"{words} time" if of.unit == "ms" else words


def motion_name(condition: str) -> str:
    """Name of the motion, such as `fast`, that a run's label `condition` ends with
    after its last colon.
    """
    return condition.rsplit(":", 1)[-1]


def capitalised(text: str) -> str:
    """Copy of `text` whose first letter is a capital one."""
    return text[:1].upper() + text[1:]


def scatter_rows(
    spreads: Iterable[Spread], sources: Sequence[ScatterSource]
) -> list[tuple[str, ...]]:
    """Table rows on quantities that differ from run to run: name, size of the scatter,
    its interval, and a remedy.
    """
    known = {source.name: source for source in sources}
    rows: list[tuple[str, ...]] = []
    for s in (each for each in spreads if each.name in known):
        of = known[s.name]
        unit = s.unit
        factor, shown = SPREAD_UNITS.get(unit, (1.0, unit))
        value, low, high = (
            number_text(factor * v, 2) for v in (s.value, s.low, s.high)
        )
        rows.append(
            (of.sentence, f"{value} {shown}", f"{low} to {high} {shown}", of.remedy)
        )
    return rows


def remedy_lines(scatter: Iterable[Spread]) -> Iterator[str]:
    """Lines of text on quantities that differ from fold to fold of a strip, each with
    its size and a remedy.
    """
    for what, size, _, remedy in scatter_rows(scatter, KNOWN_EFFECTS):
        yield (
            f"{what} differs by {size} from run to run; {remedy}, or make each motion"
            " four times"
        )
