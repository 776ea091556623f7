"""Base parameters, candidate effects and descriptive terms of a strip's model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from cell.gap.subject.strip.measurement_errors import KNOWN_EFFECTS
from cell.gap.subject.subject import Candidate, Quantity, Scope
from drivers.base.errors import Unsupported
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.effects.effect import FARTHEST, SECANT, Effect, Parameter, Stage
from drivers.strip.file import StripFile
from drivers.strip.law import LAW_TERMS
from drivers.strip.rod.lumping import check

# bending lengths between the places at which a local effect is screened
PLACE_SPACING = 0.9
TRIED_TIMES = (0.1, 0.5, 2.5)  # s, tried where an effect has a time of its own
POSITION_STEP = 0.002  # m, of finite differences over the place of an effect
# relative error of a law of cloth, which differs between fabrics: yarn friction 15 %
UNTRUE = 0.2
# relative, of the bending lengths of one fabric's specimens; assumed
SPECIMEN_SPREAD = 0.15
PLACE_ERROR = 0.02  # relative error of lengths, offsets and delays
WEIGHED = 0.05  # relative spread of an areal density by a laboratory's scale and ruler
SHORTEST_RETARDATION = 0.005  # s, about which the fit of an undamped strip starts


def _places(strip: StripFile, lifted: float) -> tuple[float, ...]:
    """Positions [m] along a strip at which a local effect, such as a crease, is tried
    first, beginning at `lifted` [m] from the fixed edge.

    A bend shows a local effect while it passes, so that probes farther apart than about
    a bending length miss what lies between them.
    """
    apart = PLACE_SPACING * strip.bending_length
    end = strip.length
    begin = max(0.0, lifted - apart)
    count = max(2, round((end - begin) / apart))
    return tuple(np.linspace(begin, end, 2 * count + 1)[1::2].tolist())


def scope(strip: StripFile, lifted: float = 0.0, *, has_force: bool = False) -> Scope:
    """What a fit of `strip` may change: the parameters of its file, the candidate
    effects, and the quantities in which residuals are shown.

    The strip is lifted off the desk from `lifted` [m] on; its part before does not
    move. Where force is measured (`has_force`), it weighs the strip.
    """
    fresh = [e for e in registry().values() if e.name not in strip.effects]
    return Scope(
        base=(*_base(strip, has_force=has_force), *_accepted_parameters(strip)),
        candidates=tuple(
            candidate(e, strip, lifted) for e in fresh if _can_simulate(e, strip)
        ),
        terms=tuple(candidate(term, strip, lifted) for term in LAW_TERMS.values()),
        scatter=KNOWN_EFFECTS,
        quantities={
            "profile": Quantity("profile_mm", 1e3, "mm"),
            "contact_x": Quantity("contact_x_mm", 1e3, "mm"),
            "displacement": Quantity("displacement_mm", 1e3, "mm"),
            "touch_x": Quantity("", 1e3, "mm"),
            "touch_time": Quantity("touch_ms", 1e3, "ms"),
            "force": Quantity("", 1e3, "mN"),
        },
    )


def _can_simulate(effect: Effect, strip: StripFile) -> bool:
    """Whether the simulated rod can represent the effect on this strip, tried at the
    weakest size.
    """
    weakest = candidate(effect, strip, lifted=0.0).probes[0][0]
    try:
        check([describe(strip, {effect.name: effect.stated(weakest) or {}})])
    except Unsupported:
        return False
    return True


def _base(strip: StripFile, *, has_force: bool) -> list[Parameter]:
    """Parameters of the strip's file that are always fitted: bending length,
    retardation time and, where force is measured, areal density.

    At one bending length the areal density changes only force and air drag.
    """
    c = strip.bending_length
    tau = max(strip.retardation_time, SHORTEST_RETARDATION)
    m = strip.areal_density
    near = (1 - SPECIMEN_SPREAD) * c, (1 + SPECIMEN_SPREAD) * c
    # start, bounds, step and prior spread
    numbers = {
        ("bending_length", "m"): (
            c,
            max(0.002, c / 3),
            min(0.2, 3 * c),
            0.003 * c,
            0.5 * c,
        ),
        ("retardation_time", "s"): (
            tau,
            0.1 * tau,
            min(10.0, 30 * tau),
            0.02 * tau,
            2 * tau,
        ),
    }
    if has_force:
        numbers["areal_density", "kg/m^2"] = m, m / 3, 3 * m, 0.02 * m, WEIGHED * m

    tolerated = {"bending_length": near, **strip.spread}
    return [
        Parameter(name, unit, *each, tolerated=tolerated.get(name))
        for (name, unit), each in numbers.items()
    ]


def _accepted_parameters(strip: StripFile) -> list[Parameter]:
    """Parameters of the effects that the strip file has accepted, which are fitted
    again together with its own values.
    """
    accepted = []
    for name, values in strip.effects.items():
        for p in _parameters(registry()[name], strip):
            key = p.name
            if key in values:
                start = p.stated_value(values[key])
                spread = 0.5 * abs(start) + p.step
                own = replace(p, name=f"{name}.{key}", start=start, spread=spread)
                accepted.append(own)
    return accepted


def fitted_strip(strip: StripFile, values: Mapping[str, float]) -> StripFile:
    """Copy of the `strip` file with the fitted `values`, given by name, in place of its
    own; `effect.parameter` names one of an effect.
    """
    effects = {name: dict(stated) for name, stated in strip.effects.items()}
    for name, value in values.items():
        effect, _, key = name.rpartition(".")
        if effect:
            effects[effect][key] = value
    own = {name: value for name, value in values.items() if "." not in name}
    return strip.model_copy(update={**own, "effects": effects})


def candidate(effect: Effect, strip: StripFile, lifted: float) -> Candidate:
    """Candidate for a fit from an effect of the library on `strip`, of which the part
    beyond `lifted` [m] leaves the desk.
    """
    parameters = _parameters(effect, strip)
    fitted = tuple(p for p in parameters if p.role != "shape")
    return Candidate(
        name=effect.name,
        sentence=effect.sentence,
        of=effect.of,
        parameters=fitted,
        probes=_probes(effect, fitted, strip, lifted),
        revealed_by=effect.revealed_by,
        model_error=UNTRUE if effect.stage is Stage.LAW else PLACE_ERROR,
        shape_parameters=tuple(p for p in parameters if p.role == "shape"),
        usual=max(_deviations(effect, strip)),
    )


def _deviations(effect: Effect, strip: StripFile) -> list[float]:
    """How far each usual size of an effect on `strip` lies from the value at which the
    effect vanishes.
    """
    amount = effect.parameters[0]
    return [
        abs(amount.stated_value(size) - amount.start) for size in effect.sizes(strip)
    ]


def _parameters(effect: Effect, strip: StripFile) -> list[Parameter]:
    """Parameters of the effect as they are fitted to `strip`, with steps and prior
    spreads that follow from the effect's usual sizes.
    """
    sizes = _deviations(effect, strip)
    step = SECANT * min(sizes)
    spread = FARTHEST * max(sizes)
    return [_fitted(p, strip.length, step, spread) for p in effect.parameters]


def _fitted(p: Parameter, length: float, step: float, spread: float) -> Parameter:
    """Copy of the parameter `p` of an effect with the bounds, step and prior spread for
    a fit to a strip of `length` [m].
    """
    if p.role == "place":
        low = max(p.low, 0.0)
        high = min(p.high, length)
        return replace(
            p,
            start=0.5 * (low + high),
            low=low,
            high=high,
            step=POSITION_STEP,
            spread=high - low,
        )
    if p.is_amount:  # whose null may lie below its range
        return replace(
            p, low=min(p.low, p.start), step=step, spread=min(p.spread, spread)
        )
    return p


def _probes(
    effect: Effect, parameters: Sequence[Parameter], strip: StripFile, lifted: float
) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Groups of parameter values at which the effect is tried first: a group for each
    size and shape, a tuple of values for each amount.
    """
    tried = {"place": _places(strip, lifted), "time": TRIED_TIMES}
    shapes = [tried.get(p.role, (p.start,)) for p in parameters]
    amounts = [i for i, p in enumerate(parameters) if p.is_amount]
    sizes = map(parameters[0].stated_value, effect.sizes(strip))
    return tuple(
        tuple((*shape[:i], size, *shape[i + 1 :]) for i in amounts)
        for size, shape in product(sizes, product(*shapes))
    )
