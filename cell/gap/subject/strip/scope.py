"""Base parameters, candidate effects and descriptive terms of a strip's model."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from cell.gap.subject.strip.measurement_errors import KNOWN_EFFECTS
from cell.gap.subject.subject import Candidate, Parameter, Quantity, Scope
from drivers.errors import Unsupported
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect, Parameter as Number, Stage
from drivers.strip.file import StripFile
from drivers.strip.law import LAW_TERMS, Term
from drivers.strip.rod.lumping import check

PLACE_SPACING = 0.9  # bending lengths between the places at which a local effect is screened
SECANT = 0.1  # of a term's size or of the smallest probe: step of finite differences
TRIED = (0.0, 0.5, 0.9)  # probes between a term's size and its maximum, on a logarithmic scale
TRIED_TIMES = (0.1, 0.5, 2.5)  # s, tried where an effect has a time of its own
FARTHEST = 3.0  # times the largest probe: prior spread of an effect's amount
SHAPE_SPREAD = 0.5  # of its default: prior spread of a number that shapes an effect
UNKNOWN_SPREAD = 4.0  # of its start: prior spread of such a number where there is no default
PLACE_STEP = 0.002  # m, of finite differences over the place of an effect
SHAPE_STEP = 0.02  # of its start: step of a number that shapes an effect
UNTRUE = 0.2  # relative error of a law of cloth, which differs between fabrics: yarn friction 15 %
SPECIMEN_SPREAD = 0.15  # relative, of the bending lengths of one fabric's specimens; assumed
PLACE_ERROR = 0.02  # relative error of lengths, offsets and delays
WEIGHED = 0.05  # relative spread of an areal density by a laboratory's scale and ruler
SHORTEST_RETARDATION = 0.005  # s, about which the fit of an undamped strip starts


def _places(strip: StripFile, lifted: float) -> tuple[float, ...]:
    """Positions [m] along the strip at which effects are screened, from `lifted` [m] on.

    A bend shows a local effect while it passes, so that probes farther apart than about a bending
    length miss what lies between them.
    """
    begin = max(0.0, lifted - PLACE_SPACING * strip.bending_length)
    count = max(2, round((strip.length - begin) / (PLACE_SPACING * strip.bending_length)))
    return tuple(map(float, np.linspace(begin, strip.length, 2 * count + 1)[1::2]))


def _term_candidate(term: Term) -> Candidate:
    """Candidate effect of a descriptive law `term`, whose only parameter is its amount."""
    step = SECANT * term.size
    amount = Parameter("amount", term.unit, 0.0, term.least, term.most, step=step, spread=term.most)
    sizes = term.size * (term.most / term.size) ** np.array(TRIED)
    probes = tuple(((float(size),),) for size in sizes)
    return Candidate(term.name, term.sentence, "strip", (amount,), probes)


def scope(strip: StripFile, lifted: float = 0.0, *, has_force: bool = False) -> Scope:
    """Fit problem of `strip`: base parameters, candidate effects, and displayed quantities.

    The strip is lifted off the desk from `lifted` [m] on; its part before does not move. Where
    force is measured (`has_force`), it weighs the strip.
    """
    fresh = [e for e in registry().values() if e.name not in strip.effects]
    return Scope(
        base=(*_base(strip, has_force=has_force), *_accepted_parameters(strip)),
        candidates=tuple(candidate(e, strip, lifted) for e in fresh if _can_simulate(e, strip)),
        terms=tuple(map(_term_candidate, LAW_TERMS.values())),
        scatter=KNOWN_EFFECTS,
        quantities={
            "profile": Quantity("profile_mm", 1e3, "mm"),
            "contact_x": Quantity("contact_x_mm", 1e3, "mm"),
            "displacement": Quantity("displacement_mm", 1e3, "mm"),
            "touch_x": Quantity("", 1e3, "mm"),
            "touch_time": Quantity("touch_ms", 1e3, "ms"),
            "force": Quantity("", 1e3, "mN"),
        },
    )  # fmt: skip


def _can_simulate(effect: Effect, strip: StripFile) -> bool:
    """Whether the rod engine can represent the effect on this strip."""
    vector = _probes(effect, strip, 0.0)[0][0]
    try:
        check([describe(strip, {effect.name: to_file_values(effect, vector) or {}})])
    except Unsupported:
        return False
    return True


def _base(strip: StripFile, *, has_force: bool) -> list[Parameter]:
    """Base parameters of a strip: bending length, retardation time, and density with a force.

    At one bending length the areal density changes only force and air drag.
    """
    c, tau = strip.bending_length, max(strip.retardation_time, SHORTEST_RETARDATION)
    m, near = strip.areal_density, ((1 - SPECIMEN_SPREAD) * c, (1 + SPECIMEN_SPREAD) * c)
    parameters = [
        Parameter("bending_length", "m", c, max(0.002, c / 3), min(0.2, 3 * c), step=0.003 * c,
                  spread=0.5 * c, tolerated=strip.spread.get("bending_length", near)),
        Parameter("retardation_time", "s", tau, 0.1 * tau, min(10.0, 30 * tau), step=0.02 * tau,
                  spread=2 * tau, tolerated=strip.spread.get("retardation_time")),
        Parameter("areal_density", "kg/m^2", m, m / 3, 3 * m, step=0.02 * m, spread=WEIGHED * m,
                  tolerated=strip.spread.get("areal_density")),
    ]  # fmt: skip
    return parameters if has_force else parameters[:-1]


def _accepted_parameters(strip: StripFile) -> list[Parameter]:
    """Base parameters for the effects in the strip file, which are refitted with the base."""
    accepted = []
    for name, values in strip.effects.items():
        effect = registry()[name]
        for p in _parameters(effect, strip, [p for p in effect.parameters if p.name in values]):
            start = p.stated_value(values[p.name])  # its own inverse
            spread = 0.5 * abs(start) + p.step
            accepted.append(replace(p, name=f"{name}.{p.name}", start=start, spread=spread))
    return accepted


def candidate(effect: Effect, strip: StripFile, lifted: float) -> Candidate:
    """Candidate effect of the library on `strip`, lifted off the desk from x = `lifted` [m] on."""
    shape = tuple(_shape_parameter(p, strip) for p in effect.parameters if p.role == "shape")
    return Candidate(
        effect.name, effect.sentence, effect.of,
        parameters=tuple(_parameters(effect, strip, _always_fitted(effect))),
        probes=_probes(effect, strip, lifted), revealed_by=effect.revealed_by,
        model_error=UNTRUE if effect.stage is Stage.LAW else PLACE_ERROR, shape_parameters=shape,
    )  # fmt: skip


def _always_fitted(effect: Effect) -> list[Number]:
    """Parameters of an effect that are always fitted: all but those of role `shape`."""
    return [p for p in effect.parameters if p.role != "shape"]


def _parameters(effect: Effect, strip: StripFile, numbers: Sequence[Number]) -> list[Parameter]:
    """Engine parameters for `numbers` of the effect, scaled by the sizes of its probes."""
    switch = effect.parameters[0]
    sizes = [abs(_to_engine(switch, size) - (switch.null or 0.0)) for size in effect.sizes(strip)]
    return [
        _amount_parameter(p, SECANT * min(sizes), FARTHEST * max(sizes))
        if _is_amount(effect, p)
        else _shape_parameter(p, strip)
        for p in numbers
    ]


def _amount_parameter(p: Number, step: float, spread: float) -> Parameter:
    """Engine parameter for an effect's amount: the reciprocal if its null is at infinity."""
    if p.null is None:
        return Parameter(
            p.name, p.unit, 0.0, 0.0, 1.0 / p.low, step=step, spread=spread, inverse=True
        )
    low, high = min(p.low, p.null), max(p.high, p.null)
    return Parameter(p.name, p.unit, p.null, low, high, step=step, spread=spread)


def _shape_parameter(p: Number, strip: StripFile) -> Parameter:
    """Engine parameter for a place, time or shape of an effect."""
    low, high = p.low, p.high
    if p.role == "place":
        low, high = max(low, 0.0), min(high, strip.length)
        start = 0.5 * (low + high)
        step = PLACE_STEP
        spread = high - low
    elif p.role == "shape":
        guess = p.guess or 0.0
        start = p.default or 0.0
        step = SECANT * guess
        spread = FARTHEST * guess
    else:
        start = p.default if p.default is not None else float(np.sqrt(low * high))
        share = SHAPE_SPREAD if p.default is not None else UNKNOWN_SPREAD
        step, spread = SHAPE_STEP * start, share * start
    return Parameter(p.name, p.unit, start, low, high, step=step, spread=spread, shape=True)


def _probes(
    effect: Effect, strip: StripFile, lifted: float
) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Groups of parameter vectors to screen: a group per size and shape, a vector per amount."""
    switch = effect.parameters[0]
    numbers = _always_fitted(effect)
    start = [p.start for p in _parameters(effect, strip, numbers)]
    amounts = [i for i, p in enumerate(numbers) if _is_amount(effect, p)]
    places = _places(strip, lifted)
    tried = [_screened_values(p, v, places) for p, v in zip(numbers, start, strict=True)]
    shapes = [t if i not in amounts else (start[i],) for i, t in enumerate(tried)]
    groups = []
    for size, vector in product(effect.sizes(strip), product(*shapes)):
        amount = _to_engine(switch, size)
        group = [[*vector[:i], amount, *vector[i + 1 :]] for i in amounts]
        groups.append(tuple(tuple(map(float, probe)) for probe in group))
    return tuple(groups)


def _screened_values(p: Number, start: float, places: tuple[float, ...]) -> tuple[float, ...]:
    """Values at which a place, a time or another number of an effect is tried in screening."""
    if p.role == "place":
        return places
    return TRIED_TIMES if p.role == "time" else (start,)


def _is_amount(effect: Effect, p: Number) -> bool:
    """Whether the parameter is an amount of the effect: its first, or another one with a null."""
    return p is effect.parameters[0] or p.null is not None


def _to_engine(switch: Number, value: float) -> float:
    """Convert a file's value to the engine's: the reciprocal if the null is at infinity."""
    return value if switch.null is not None else 1.0 / value


def to_file_values(effect: Effect, values: Sequence[float]) -> dict[str, float] | None:
    """Values of an effect as strip files state them, by name; None for an absent effect.

    `values` may lack those of the shape, which come last.
    """
    stated = dict(zip((p.name for p in effect.parameters), map(float, values), strict=False))
    switch = effect.parameters[0]
    if switch.null is None:
        if stated[switch.name] <= 1.0 / switch.high:
            return None
        stated[switch.name] = 1.0 / stated[switch.name]
    return stated
