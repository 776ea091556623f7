"""Sentences, numbers and units of a fit's verdict, for a technician."""

from collections.abc import Iterator, Mapping, Sequence

from cell.gap.subject.strip.measurement_errors import KNOWN_EFFECTS
from cell.gap.subject.subject import Quantity
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Deviation, ValueWithUnit, Verdict

POWERS = {"^2": "²", "^3": "³", "^4": "⁴"}
SMALL_UNITS = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "s": (1e3, "ms"), "kg": (1e3, "g")}
"""Units shown in thousandths, so that a page has one unit for each kind of quantity."""
TITLES = {
    "ambiguous": "Something is missing, and these runs cannot tell what",
    "no_gap": "No gap",
    "unexplained": "Something is missing that the library does not explain",
}
SMALLEST_GAIN = 1.0  # sigma that a smaller spread must add to be worth a word
SPREAD_UNITS = {**SMALL_UNITS, "1": (100.0, "%"), "N": (1e3, "mN")}


def in_small_unit(value: float, of: str) -> float:
    """`value`, stated in `of`, converted to the unit that a page shows."""
    return value * SMALL_UNITS.get(of, (1.0, of))[0]


def unit(text: str) -> str:
    """Symbol of the unit in which pages show `text`: mm for m, ms for s; none for pure numbers."""
    text = SMALL_UNITS.get(text, (1.0, text))[1]
    for plain, raised in POWERS.items():
        text = text.replace(plain, raised)
    return "" if text == "1" else text.replace(" ", "\N{NO-BREAK SPACE}")


def number(value: float, digits: int = 3) -> str:
    """Text of a number in few digits, a power of ten written out."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{raised}"


def probability(p: float) -> str:
    """Text of a probability; one below one in a billion is given as that bound."""
    return "< 10⁻⁹" if p < 1e-9 else number(p, 2)


def quantity(value: float, of: str) -> str:
    """Text of a number in the unit `of` with its unit, as a page shows it."""
    return f"{number(in_small_unit(value, of))}\N{NO-BREAK SPACE}{unit(of)}".rstrip(
        "\N{NO-BREAK SPACE}"
    )


def interval(value: ValueWithUnit) -> str:
    """Text of an estimate with its interval and unit."""
    if value.low is None or value.high is None:
        return quantity(value.value, value.unit)
    low, middle, high = (
        number(in_small_unit(v, value.unit)) for v in (value.low, value.value, value.high)
    )
    return f"{middle} [{low}, {high}] {unit(value.unit)}".rstrip()


def headline(verdict: Verdict) -> str:
    """One-line verdict: deviations from the file, then named effects, or what remains open."""
    parts = []
    if verdict.deviates:
        names = ", ".join(d.parameter.replace("_", " ") for d in verdict.deviates)
        parts.append(f"Not as the file states: {names}")
    if verdict.verdict != "named":
        return "; ".join([*parts, TITLES[verdict.verdict]])
    for effect in verdict.effects:
        name, value = next(iter(effect.parameters.items()))
        parts.append(f"{effect.name}: {name.replace('_', ' ')} {interval(value)}")
    return "; ".join(parts)


def sentence(findings: Findings, verdict: Verdict) -> str:
    """Sentence on the missing effect and its certainty, for a technician; sizes stand elsewhere."""
    words = {
        "named": _name_effects,
        "ambiguous": _ambiguity,
        "no_gap": _no_gap,
        "unexplained": _describe_rest,
    }
    return words[verdict.verdict](findings, verdict)


def _name_effects(findings: Findings, verdict: Verdict) -> str:
    """Sentence on the named effects, with doubts about them."""
    sentences = {c.name: c.sentence for c in findings.subject.scope.candidates}
    effects = ", and ".join(
        f"{sentences[e.name]} ({e.name}: {_parameter_values(e.parameters)}; right with "
        f"probability {e.confidence:.2f})"
        for e in verdict.effects
    )
    text = f"{effects}."
    if ends := at_their_ends(findings):
        text += f" At the end of the range that is tried, and perhaps beyond: {', '.join(ends)}."
    if verdict.ambiguous:
        either = "; ".join(" or ".join(group) for group in verdict.ambiguous)
        text += f" Beside it something is missing that these runs cannot tell apart: {either}"
        text += f" (the numbers are with {' and '.join(sorted(_class_members(findings)))})."
    return capital(text)


def _class_members(findings: Findings) -> frozenset[str]:
    """Effects of the accepted model that represent a class of indistinguishable ones."""
    return findings.accepted.model.names - {e.name for e in findings.separable}


def _ambiguity(findings: Findings, verdict: Verdict) -> str:
    sentences = {c.name: f"{c.sentence} ({c.name})" for c in findings.subject.scope.candidates}
    sentences |= {p.name: f"the file is wrong about {p.name}" for p in findings.subject.scope.base}
    groups = [[sentences.get(name, name) for name in group] for group in verdict.ambiguous]
    either = "; ".join(", or ".join(group) for group in groups)
    split = "No planned experiment would split them"
    if verdict.advice:
        split = f"The experiment that would split them: {verdict.advice[0].experiment}"
    return f"Something is missing that these runs cannot tell apart: {either}. {split}."


def _no_gap(findings: Findings, verdict: Verdict) -> str:
    many = len(verdict.detectable)
    sizes = f" {many} effects would have shown, from the sizes listed below on." if many else ""
    silent = undetectable(findings)
    never = f" Not detectable here at any possible size: {', '.join(silent)}." if silent else ""
    return f"The model explains the fitted runs down to their noise.{sizes}{never}"


def _describe_rest(findings: Findings, verdict: Verdict) -> str:
    rest = verdict.unexplained
    description = rest.description if rest is not None else ""
    accepted = findings.accepted.model
    tried = f"; {accepted.name} explains a part but not all of it" if accepted.effects else ""
    return capital(f"{description}: no effect of the library accounts for it{tried}.")


def at_their_ends(findings: Findings) -> list[str]:
    """Names of the parameters of surely named effects whose fitted value is a bound."""
    fit = findings.accepted.estimate
    _, values = fit.model.split(fit.shared)
    return [
        f"{e.name} {p.name.replace('_', ' ')}"
        for e in findings.separable
        for p, value in zip(e.parameters, values[e.name], strict=True)
        if value in (p.low, p.high) and value != p.start
    ]


def deviation(deviates: Sequence[Deviation]) -> str:
    """Line for an operator on the values that deviate from the file."""
    parts = []
    for d in deviates:
        ends = (quantity(end, d.unit) if end is not None else "any" for end in d.tolerated)
        parts.append(
            f"{d.parameter.replace('_', ' ')} {interval(d)}, the file states "
            f"{quantity(d.stated, d.unit)} and tolerates {' to '.join(ends)}"
        )
    return f"not as the file states: {'; '.join(parts)}"


def _parameter_values(parameters: dict[str, ValueWithUnit]) -> str:
    return ", ".join(
        f"{name.replace('_', ' ')} {quantity(v.value, v.unit)}" for name, v in parameters.items()
    )


def undetectable(findings: Findings) -> list[str]:
    """Effects that would have shown in these runs at no size that is physically possible."""
    return sorted(name for name, size in findings.screen.detectable.items() if size is None)


def smallest(findings: Findings, name: str, value: float) -> str:
    """Text of the detection limit of an effect: an upper limit for reciprocal parameters."""
    candidate = next(c for c in findings.subject.scope.candidates if c.name == name)
    first = candidate.parameters[0]
    return f"{'at most ' if first.inverse else ''}{quantity(value, first.unit)}"


def label(of: Quantity) -> str:
    """Name of a quantity in words."""
    words = of.key.rsplit("_", 1)[0].replace("_", " ")
    return f"{words} time" if of.unit == "ms" else words


def motion(condition: str) -> str:
    """Motion of a condition, such as `fast`."""
    return condition.rsplit(":", 1)[-1]


def capital(text: str) -> str:
    """`text` with a capital first letter."""
    return text[:1].upper() + text[1:]


def repeats(findings: Findings) -> list[tuple[str, ...]] | None:
    """Rows on each quantity that differs from run to run; None if none may.

    What differs, its spread with interval, the gain in separation if it were halved, its remedy.
    """
    if not any(p.random for run in findings.subject.runs for p in run.local):
        return None
    known = {e.name: e for e in findings.subject.scope.scatter}
    more = {s.name: f"{s.sigma:.1f} sigma more" for s in findings.advice.steadier}
    rows: list[tuple[str, ...]] = []
    for s in findings.model_tests.scatter:
        factor, shown = SPREAD_UNITS.get(s.unit, (1.0, s.unit))
        value, low, high = (number(factor * v, 2) for v in (s.value, s.low, s.high))
        of = known[s.name]
        rows.append((of.sentence, f"{value} {shown}", f"{low} to {high} {shown}",
                     more.get(s.name, ""), of.remedy))  # fmt: skip
    return rows


def remedies(
    spreads: Mapping[str, tuple[float, str]], steadier: Mapping[str, float], planned: float
) -> Iterator[str]:
    """Lines on each run-to-run spread, and whether halving it would help more than a new motion.

    `spreads` are standard deviations with their units; with half of one, the runs would separate
    two explanations by `steadier` [sigma] more, by name; the best motion separates by `planned`.
    """
    known = {e.name: e for e in KNOWN_EFFECTS}
    for name in filter(known.get, spreads):
        (value, unit), effect = spreads[name], known[name]
        factor, shown = SPREAD_UNITS.get(unit, (1.0, unit))
        line = f"{effect.sentence} differs by {number(factor * value, 2)} {shown} from run to run"
        more = steadier.get(name, 0.0)
        if more < SMALLEST_GAIN:
            yield f"{line}: halving it would not separate the explanations better"
        else:
            than = "more" if more > planned else "less"
            yield (
                f"{line}: halving it would separate them by {more:.1f} sigma more, {than} than any "
                f"motion ({planned:.1f}): {effect.remedy}, or each motion made four times"
            )
