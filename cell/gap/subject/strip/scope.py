"""Base parameters and candidate effects of a strip's model."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from cell.gap.subject.strip.layout import Floors
from cell.gap.subject.strip.probes import places
from cell.gap.subject.strip.scatter import KNOWN_EFFECTS
from cell.gap.subject.strip.terms import candidates
from cell.gap.subject.subject import Candidate, Parameter, Quantity, Scattering, Scope
from drivers.errors import Unsupported
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect, Stage
from drivers.strip.effects.effect import Parameter as Number
from drivers.strip.file import StripFile
from drivers.strip.rod.lumping import check

TRIED_TIMES = (0.1, 0.5, 2.5)  # s, tried where an effect has a time of its own
FARTHEST = 3.0  # times the largest probe: the spread of what is known of an effect before
SHAPE_SPREAD = 0.5  # of its default: the spread of a number that shapes an effect
UNKNOWN_SPREAD = 4.0  # of its start: the spread of such a number where there is no default
LEFT = 0.1  # of a gap, that effects may leave together: a single wrong law leaves more
UNTRUE = 0.2  # of a law of cloth, which is never quite that of another: of yarn friction 15 %
SPECIMEN_SPREAD = 0.15  # of a bending length: how far the exam's specimens of one fabric lie apart
PLACE_ERROR = 0.02  # of where something is: lengths, offsets, delays
SECANT = 0.1  # of the smallest probe: the step of secants
WEIGHED = 0.05  # of an areal density: the spread of what a laboratory's scale and ruler say


def scope(
    strip: StripFile,
    floors: Floors,
    lifted: float = 0.0,
    without: Sequence[str] = (),
    *,
    has_force: bool = False,
) -> Scope:
    """Base parameters, candidates and quantities of `strip`; its own effects belong to the base.

    The strip is lifted off the desk from `lifted` [m] on; what lies before does not move.
    Effects `without` are withheld from the candidates. Where force is measured (`has_force`), it
    weighs the strip.
    """
    fresh = [e for e in registry().values() if e.name not in {*strip.effects, *without}]
    return Scope(
        base=(
            *_base(strip),
            *(_density_parameter(strip) if has_force else ()),
            *_accepted_parameters(strip),
        ),
        candidates=tuple(candidate(e, strip, lifted) for e in fresh if can_simulate(e, strip)),
        terms=candidates(),
        left=LEFT,
        scatter=tuple(Scattering(e.name, e.sentence, e.remedy) for e in KNOWN_EFFECTS),
        quantities={
            "profile": Quantity("profile_mm", 1e3, "mm", 2 * floors.profile),
            "contact_x": Quantity("contact_x_mm", 1e3, "mm", 2 * floors.contact_x),
            "displacement": Quantity("displacement_mm", 1e3, "mm", 2 * floors.displacement),
            "touch_x": Quantity("", 1e3, "mm", floors.displacement),
            "touch_time": Quantity("touch_ms", 1e3, "ms", 2 * floors.touch_time),
            "force": Quantity("", 1e3, "mN", 2 * floors.force),
        },
    )


def can_simulate(effect: Effect, strip: StripFile) -> bool:
    """Whether the rod can represent the effect."""
    vector = _probes(effect, strip, 0.0)[0][0]
    try:
        check([describe(strip, {effect.name: file_values(effect, vector) or {}})])
    except Unsupported:
        return False
    return True


def _base(strip: StripFile) -> list[Parameter]:
    """Base parameters bending length and retardation time, known within a factor."""
    c, b = strip.bending_length, max(strip.retardation_time, 0.005)
    near = ((1 - SPECIMEN_SPREAD) * c, (1 + SPECIMEN_SPREAD) * c)
    return [
        Parameter("bending_length", "m", c, max(0.002, c / 3), min(0.2, 3 * c), 0.003 * c, 0.5 * c,
                  tolerated=strip.spread.get("bending_length", near)),
        Parameter("retardation_time", "s", b, 0.1 * b, min(10.0, 30 * b), 0.02 * b, 2 * b,
                  tolerated=strip.spread.get("retardation_time")),
    ]  # fmt: skip


def _density_parameter(strip: StripFile) -> list[Parameter]:
    """Base parameter areal density, which moves only force and air drag at one bending length."""
    m = strip.areal_density
    return [
        Parameter("areal_density", "kg/m^2", m, m / 3, 3 * m, 0.02 * m, WEIGHED * m,
                  tolerated=strip.spread.get("areal_density")),
    ]  # fmt: skip


def _accepted_parameters(strip: StripFile) -> list[Parameter]:
    """Parameters of the effects in the strip file: known, and refitted with the base."""
    found = []
    for name, values in strip.effects.items():
        effect = registry()[name]
        given = [p for p in effect.parameters if p.name in values]
        for number, p in zip(given, _parameters(effect, strip, given), strict=True):
            start = _to_engine(number, values[number.name]) if p.inverse else values[number.name]
            spread = 0.5 * abs(start) + p.step
            label = f"{name}.{p.name}"
            found.append(replace(p, name=label, start=start, spread=spread))
    return found


def candidate(effect: Effect, strip: StripFile, lifted: float) -> Candidate:
    """The effect as a candidate of the engine."""
    return Candidate(
        name=effect.name,
        sentence=effect.sentence,
        of=effect.of,
        parameters=tuple(_parameters(effect, strip, coarse(effect))),
        probes=_probes(effect, strip, lifted),
        revealed_by=effect.revealed_by,
        model_error=UNTRUE if effect.stage is Stage.LAW else PLACE_ERROR,
        shape_parameters=tuple(
            _shape_parameter(p, strip) for p in effect.parameters if p.role == "shape"
        ),
    )


def coarse(effect: Effect) -> list[Number]:
    """Parameters of the effect, without the finer ones of its shape."""
    return [p for p in effect.parameters if p.role != "shape"]


def _parameters(effect: Effect, strip: StripFile, numbers: Sequence[Number]) -> list[Parameter]:
    tried = [_to_engine(effect.parameters[0], v) for v in effect.sizes(strip)]
    null = _null(effect.parameters[0])
    least, most = (pick(abs(v - null) for v in tried) for pick in (min, max))
    return [
        _amount_parameter(p, SECANT * least, FARTHEST * most)
        if is_amount(effect, p)
        else _shape_parameter(p, strip)
        for p in numbers
    ]


def _amount_parameter(p: Number, step: float, spread: float) -> Parameter:
    """Parameter for the amount of an effect; for one that vanishes at infinity, its reciprocal."""
    if p.null is None:
        return Parameter(p.name, p.unit, 0.0, 0.0, 1.0 / p.low, step, spread, inverse=True)
    low, high = min(p.low, p.null), max(p.high, p.null)
    return Parameter(p.name, p.unit, p.null, low, high, step, spread)


def _shape_parameter(p: Number, strip: StripFile) -> Parameter:
    """Parameter for the place or shape of an effect."""
    if p.role == "place":
        low, high = max(p.low, 0.0), min(p.high, strip.length)
        middle = 0.5 * (low + high)
        return Parameter(p.name, p.unit, middle, low, high, 0.002, high - low, shape=True)
    if p.role == "shape":
        guess = p.guess or 0.0
        start, step, spread = p.default or 0.0, SECANT * guess, FARTHEST * guess
        return Parameter(p.name, p.unit, start, p.low, p.high, step, spread, shape=True)
    start = p.default if p.default is not None else float(np.sqrt(p.low * p.high))
    step, spread = 0.02 * start, (SHAPE_SPREAD if p.default is not None else UNKNOWN_SPREAD) * start
    return Parameter(p.name, p.unit, start, p.low, p.high, step, spread, shape=True)


def _probes(
    effect: Effect, strip: StripFile, lifted: float
) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Groups of vectors to screen, a group for each size and shape, a vector for each amount."""
    switch, numbers = effect.parameters[0], coarse(effect)
    start = [p.start for p in _parameters(effect, strip, numbers)]
    amounts = [i for i, p in enumerate(numbers) if is_amount(effect, p)]
    spots = places(strip, lifted)
    tried = [_screened_values(p, v, spots) for p, v in zip(numbers, start, strict=True)]
    shapes = [t if i not in amounts else (start[i],) for i, t in enumerate(tried)]
    groups = []
    for size, shape in product(_without_mirrored(effect.sizes(strip)), product(*shapes)):
        inside = _to_engine(switch, size)
        group = [[*shape[:i], inside, *shape[i + 1 :]] for i in amounts]
        groups.append(tuple(tuple(map(float, vector)) for vector in group))
    return tuple(groups)


def _without_mirrored(sizes: Sequence[float]) -> list[float]:
    """Sizes without those whose mirror image comes before: each is screened with both signs."""
    return [size for i, size in enumerate(sizes) if -size not in sizes[:i]]


def _screened_values(p: Number, start: float, spots: tuple[float, ...]) -> tuple[float, ...]:
    """Values of a parameter at which an effect is screened."""
    if p.role == "place":
        return spots
    return TRIED_TIMES if p.role == "time" else (start,)


def is_amount(effect: Effect, p: Number) -> bool:
    """Whether the parameter is an amount of the effect: its switch, or another one with a null."""
    return p is effect.parameters[0] or p.null is not None


def _to_engine(switch: Number, value: float) -> float:
    """A file's value converted to the engine's."""
    return value if switch.null is not None else 1.0 / value


def _null(p: Number) -> float:
    return 0.0 if p.null is None else p.null


def file_values(effect: Effect, values: Sequence[float]) -> dict[str, float] | None:
    """The effect's parameters as files state them; None where the effect is absent.

    Finer ones may be missing: they come last.
    """
    found = dict(zip((p.name for p in effect.parameters), map(float, values), strict=False))
    switch = effect.parameters[0]
    if switch.null is None:
        if found[switch.name] <= 1.0 / switch.high:
            return None
        found[switch.name] = 1.0 / found[switch.name]
    return found
